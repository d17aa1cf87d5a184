"""What the emulated world is really like, drawn from a seed, and the rigid tips that press into it.

Only a report may look at the truth. Tips are distance functions of revolution, lowest point at the
origin, body at z >= 0.
"""

import json
import zlib
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.run_files import read_bytes

TRUTH_FILE = "truth.json"
_POISSON_OFFSETS = (-0.01, -0.005, 0.0, 0.005, 0.01)  # few, because each needs a press table
_POISSON_LIMIT = 0.49
FRICTION = 0.5
"""Between indenter and gel where nothing else is asked for: the paper's section III-C."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GelDisc:
    """The gel at rest."""

    radius_m: float = 12.9e-3  # radius of the disc [m]
    thickness_m: float = 4.0e-3  # height of its highest point above the clamped base [m]
    dome_radius_m: float = 134e-3  # radius of the domed top [m]; inf is flat
    # From the base upwards, each with its share of the height and its modulus over that of the
    # uppermost; empty for a gel of one material.
    layers: tuple[tuple[float, float], ...] = ()

    def sag(self, radius: FloatArray) -> FloatArray:
        """Return how far the surface lies below its highest point at ``radius`` [m]."""
        return 0.5 * radius**2 / self.dome_radius_m


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerGrid:
    """A rectangular grid of dots, centred on the gel."""

    columns: int = 9
    rows: int = 7
    pitch_m: tuple[float, float] = (2.41e-3, 2.46e-3)
    radius_m: float = 0.35e-3

    def rest(self) -> FloatArray:
        """Return the centres at rest [m], shape [rows * columns, 2]."""
        x = (np.arange(self.columns) - 0.5 * (self.columns - 1)) * self.pitch_m[0]
        y = (np.arange(self.rows) - 0.5 * (self.rows - 1)) * self.pitch_m[1]
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


class GelLight(StrEnum):
    """What the camera sees: painted gel lit from its sides, or a dark skin through clear gel."""

    COLOURED = "coloured"
    TRANSLUCENT = "translucent"


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedUnit:
    """One make of sensor, by the sizes that a lab reads off it; at first a GelSight Mini."""

    name: str = "gelsight-mini"
    pad_size_m: tuple[float, float] = (25.25e-3, 20.75e-3)  # length along x and y [m]
    # Of the pad's top along x and y [m]; None takes the disc's for both.
    dome_radii_m: tuple[float, float] | None = None
    # The disc of equal area that is pressed in its place.
    gel: GelDisc = field(default_factory=GelDisc)
    young_pa: float = 0.435e6  # nominal modulus of the layer that is touched [Pa]
    poisson: float = 0.48
    image_size: tuple[int, int] = (320, 240)  # columns and rows of the image that is scored [px]
    # Nominal size of its pixels on the gel, x and y [m].
    pixel_m: tuple[float, float] = (0.0634e-3, 0.0634e-3)
    crop: float = 0.15  # part of the raw frame's width and height that is cut off at each border
    light: GelLight = GelLight.COLOURED
    shadows: bool = False  # whether dents hide the lights from the gel behind them
    markers: MarkerGrid | None = None  # dots printed on the gel; None where it has none

    @property
    def dome_curvatures(self) -> tuple[float, float]:
        """Curvature of the unloaded top along x and y [1/m]."""
        radii = self.dome_radii_m or (self.gel.dome_radius_m, self.gel.dome_radius_m)
        return 1.0 / radii[0], 1.0 / radii[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantTruth:
    """One gel, one mounting, one set of lights and noises."""

    seed: int
    young_pa: float  # relaxed (long-term) Young's modulus of the gel [Pa]
    poisson: float  # Poisson's ratio, one of the tabulated ones
    relaxation_weights: tuple[float, ...]  # Prony weights over the relaxed modulus
    relaxation_times_s: tuple[float, ...]
    # Where the indenter really is, minus where the robot says, in x and y [m].
    pose_error_m: tuple[float, float]
    surface_error_m: float  # real height of the gel minus the expected one [m]
    # Real tilt of the indenter's axis (tip to flange) towards base x and y [rad]; every tilt of the
    # plant has this sign.
    tilt_rad: tuple[float, float]
    light_gain: tuple[float, float, float]  # gain of the red, green and blue light
    light_drift_ratio: float  # change of all lights when warm, relative [1]
    light_drift_time_s: float  # time constant of that [s]
    image_noise_levels: float  # standard deviation of the image noise [grey levels]
    image_scale_error: tuple[float, float]  # relative error of the scale (m per px) in x and y
    image_rotation_rad: float  # rotation of the camera about its axis [rad]
    # Where the gel's centre is seen, from the image's centre [m].
    image_shift_m: tuple[float, float]
    # Standard deviation of a force sample [N], [N m].
    force_noise_n: float
    torque_noise_nm: float
    force_offset_n: tuple[float, float, float]
    force_drift_n_s: float  # drift of Fz [N/s]
    cross_talk: tuple[float, float]  # share of Fz that shows up in Fx and Fy
    # From the pose to the first byte on the wire [s].
    force_latency_s: float
    camera_latency_s: float
    # Absent in worlds from before there was a choice.
    friction: float = 0.0
    unit: EmulatedUnit = field(default_factory=EmulatedUnit)


_TRUTH = TypeAdapter(PlantTruth)


def draw_truth(
    seed: int,
    *,
    unit: EmulatedUnit | None = None,
    friction: float = FRICTION,
    tilt_rad: tuple[float, float] | None = None,
) -> PlantTruth:
    """Draw a world; the same seed gives the same world in every process.

    Every property is drawn by its name, so that a new one leaves the others as they were.

    Args:
        unit: The make of sensor; a GelSight Mini if None.
        tilt_rad: Tilt of the indenter's axis towards base x and y, in place of the drawn one [rad].
    """

    def stream(name: str) -> np.random.Generator:
        return np.random.default_rng([seed, zlib.crc32(name.encode())])

    def normal(name: str) -> float:
        return float(np.clip(stream(name).standard_normal(), -2.0, 2.0))

    def uniform(name: str, low: float, high: float) -> float:
        return float(stream(name).uniform(low, high))

    make = unit or EmulatedUnit()
    offset = _POISSON_OFFSETS[int(uniform("poisson", 0, len(_POISSON_OFFSETS)))]
    pose_angle = uniform("pose direction", -np.pi, np.pi)
    pose_length = uniform("pose error", 1.0e-4, 3.0e-4)
    drift_sign = 1.0 if uniform("drift sign", -1.0, 1.0) > 0.0 else -1.0
    tilt = tilt_rad or [1.5e-3 * normal(f"tilt {axis}") for axis in "xy"]
    drawn = {
        "seed": seed,
        "young_pa": make.young_pa * (1.0 + 0.05 * normal("young")),
        "poisson": round(min(make.poisson + offset, _POISSON_LIMIT), 6),
        "relaxation_weights": [
            uniform("relaxation fast", 0.02, 0.04),
            uniform("relaxation slow", 0.03, 0.04),
        ],
        "relaxation_times_s": (0.3, 3.0),
        "pose_error_m": (pose_length * np.cos(pose_angle), pose_length * np.sin(pose_angle)),
        "surface_error_m": 2.0e-4 * normal("surface"),
        "tilt_rad": tilt,
        "light_gain": [1.0 + 0.03 * normal(colour) for colour in ("red", "green", "blue")],
        "light_drift_ratio": uniform("light drift", -0.015, -0.005),
        "light_drift_time_s": uniform("light drift time", 120.0, 300.0),
        "image_noise_levels": uniform("image noise", 1.2, 1.8),
        "image_scale_error": [0.005 * normal(f"scale {axis}") for axis in "xy"],
        "image_rotation_rad": 0.005 * normal("image rotation"),
        "image_shift_m": [1.5e-4 * normal(f"shift {axis}") for axis in "xy"],
        "force_noise_n": uniform("force noise", 0.005, 0.010),
        "torque_noise_nm": uniform("torque noise", 1e-4, 2e-4),
        "force_offset_n": [
            size_n * normal(f"offset {axis}")
            for axis, size_n in (("x", 0.3), ("y", 0.3), ("z", 0.8))
        ],
        "force_drift_n_s": drift_sign * uniform("drift", 4e-4, 9e-4),
        "cross_talk": [0.005 * normal(f"talk {axis}") for axis in "xy"],
        "force_latency_s": uniform("force latency", 0.002, 0.006),
        "camera_latency_s": uniform("camera latency", 0.010, 0.035),
        "friction": friction,
        "unit": asdict(make),
    }
    # By way of text, so that a truth read back from its file is equal to the one drawn.
    return _TRUTH.validate_json(json.dumps(drawn))


def write_truth(folder: Path, truth: PlantTruth) -> Path:
    """Write ``truth.json`` into ``folder`` and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / TRUTH_FILE
    path.write_text(json.dumps(asdict(truth), indent=2) + "\n")
    return path


def read_truth(path: Path) -> PlantTruth:
    """Read what ``write_truth`` wrote."""
    try:
        return _TRUTH.validate_json(read_bytes(path, what="the truth"))
    except ValueError as error:
        raise RecordError(f"truth of the emulated world {path}: {error}") from error


@dataclass(frozen=True, slots=True, kw_only=True)
class TipDistance:
    """Signed distance to a tip in the (r, z) half-plane, positive outside."""

    value: FloatArray  # distance [m], shape [point_count]
    gradient: FloatArray  # unit outward normal, shape [point_count, 2]
    hessian: FloatArray  # second derivative [1/m], shape [point_count, 2, 2]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tip:
    """A cylinder with a rounded edge; a ball is one that is all edge, up to its equator."""

    diameter_m: float

    @property
    def rim_radius_m(self) -> float:
        """Radius of the cylinder [m]."""
        return 0.5 * self.diameter_m

    @property
    def edge_radius_m(self) -> float:
        """Radius of the rounded edge [m]."""
        return self.rim_radius_m

    def height(self, radius: FloatArray) -> FloatArray:
        """Return the underside's height above the tip [m], inf beside the body."""
        edge_m = self.edge_radius_m
        inside = np.clip(radius - (self.rim_radius_m - edge_m), 0.0, edge_m)
        height = edge_m - np.sqrt(edge_m**2 - inside**2)
        return np.where(radius <= self.rim_radius_m, height, np.inf)

    def distance(self, radius: FloatArray, z: FloatArray) -> TipDistance:
        """Return the signed distance of points (r, z) [m] from the body."""
        toward_wall = radius - (self.rim_radius_m - self.edge_radius_m)
        toward_face = self.edge_radius_m - z
        corner = np.stack([np.maximum(toward_wall, 0.0), np.maximum(toward_face, 0.0)], axis=-1)
        length = np.linalg.norm(corner, axis=-1)
        core = length == 0.0
        safe = np.where(core, 1.0, length)
        normal = corner / safe[:, None] * np.array([1.0, -1.0])
        face_nearer = toward_face >= toward_wall
        normal[core] = np.where(face_nearer[core, None], [0.0, -1.0], [1.0, 0.0])
        value = np.where(core, np.maximum(toward_wall, toward_face), length) - self.edge_radius_m
        curvature = np.where((toward_wall > 0.0) & (toward_face > 0.0), 1.0 / safe, 0.0)
        tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=-1)
        hessian = curvature[:, None, None] * tangent[:, :, None] * tangent[:, None, :]
        return TipDistance(value=value, gradient=normal, hessian=hessian)


@dataclass(frozen=True, slots=True, kw_only=True)
class CylinderTip(Tip):
    """Flat punch with a rounded edge."""

    fillet_m: float = 1e-4

    @property
    def edge_radius_m(self) -> float:
        """Radius of the rounded edge [m]."""
        return self.fillet_m


class SphereTip(Tip):
    """Ball."""
