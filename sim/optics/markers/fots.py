"""Marker motion by exponentials, the cheap fidelity, beside that of the simulated surface.

After FOTS (Zhao et al., FOTS: A Fast Optical Tactile Simulator for Sim2Real Learning of
Tactile-motor Robot Manipulation Skills, RA-L 2024): dilation, shear and twist each
move a marker by an amount that decays with a Gaussian of its distance. The turn is exact: at an
angle of zero, cos(theta) - 1 and sin(theta) are zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from sim.effects.plan import plan_effects
from sim.effects.scene_path import follow, path_for
from sim.fields.press_fields import surface_state
from sim.optics.markers.material_points import surface_displacement
from sim.optics.markers.printed_markers import (
    draw_markers,
    find_markers,
    follow_markers,
    marker_places,
)
from sim.scene.scene import Motion, Scene
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import MarkerGrid
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

_LEVEL = 150
_NOISE_LEVELS = 2.0
# Where a fit starts: gain and decay of dilation, of shear and of twist.
_START = (50.0, 1e5, 1.0, 1e5, 1.0, 1e5)


@dataclass(frozen=True, slots=True, kw_only=True)
class FotsMarkers:
    """Gains and decays of the three motions.

    Attributes:
        dilate_gain: Spreading per depth and distance from the centre [1/m].
        dilate_decay: In exp(-decay r^2) [1/m^2]; likewise the next two.
        shear_gain: Share of the indenter's motion that the gel follows.
        shear_decay: [1/m^2].
        twist_gain: Share of the indenter's turn that the gel follows.
        twist_decay: [1/m^2].
    """

    dilate_gain: float
    dilate_decay: float
    shear_gain: float
    shear_decay: float
    twist_gain: float
    twist_decay: float

    def displacement(self, places: FloatArray, scene: Scene) -> FloatArray:
        """Return the markers' displacement along x, y [m], shape [n, 2].

        Args:
            places: Markers at rest [m], shape [n, 2].
        """
        arm = places - np.asarray(scene.centre_m)
        depth_m, motion = scene.target.depth_m or 0.0, scene.motion
        squared = np.sum(arm**2, axis=1, keepdims=True)
        spread = self.dilate_gain * depth_m * arm * np.exp(-self.dilate_decay * squared)
        shear = self.shear_gain * np.asarray(motion.shift_m) * np.exp(-self.shear_decay * squared)
        angle = self.twist_gain * motion.twist_rad
        turn = np.array(
            [[math.cos(angle) - 1.0, -math.sin(angle)], [math.sin(angle), math.cos(angle) - 1.0]]
        )
        twist = (arm @ turn.T) * np.exp(-self.twist_decay * squared)
        return np.asarray(spread + shear + twist)


def fit_fots(
    places: FloatArray, scenes: Sequence[Scene], displacements: Sequence[FloatArray]
) -> FotsMarkers:
    """Fit the six numbers to displacements that are known, from the simulator or from images.

    Args:
        places: Markers at rest [m], shape [n, 2].
        scenes: At least one of each motion that is to be fitted.
        displacements: Along x, y in each scene [m], each of shape [n, 2].
    """
    names = [field.name for field in fields(FotsMarkers)]

    def model(factors: FloatArray) -> FotsMarkers:
        return FotsMarkers(**dict(zip(names, (factors * _START).tolist(), strict=True)))

    def misfit(factors: FloatArray) -> FloatArray:
        trial = model(factors)
        pairs = zip(scenes, displacements, strict=True)
        off = [trial.displacement(places, scene) - known for scene, known in pairs]
        return np.ravel(off) * 1e6

    return model(least_squares(misfit, np.ones(len(names)), bounds=(0.0, np.inf)).x)


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerComparison:
    """Markers of one press by both fidelities.

    Attributes:
        largest_m: Largest displacement of a marker by the simulated surface [m].
        difference_rms_m: Root mean square distance of the exponentials from it [m].
        difference_largest_m: Largest distance [m].
        tracking_rms_px: Root mean square error of displacements tracked in rendered images with
            noise [px].
        tracking_largest_px: Largest error [px].
        tracked: Markers that were tracked.
        lost: Markers seen at rest that were not found again.
    """

    largest_m: float
    difference_rms_m: float
    difference_largest_m: float
    tracking_rms_px: float
    tracking_largest_px: float
    tracked: int
    lost: int


def compare_marker_fidelities(
    scene: Scene, motions: Mapping[str, Motion], grid: MarkerGrid, geometry: CameraGeometry
) -> tuple[FotsMarkers, dict[str, MarkerComparison]]:
    """Press as the scene says, move on as each motion says, and compare the markers' ways.

    Args:
        scene: A press to a depth, with friction where a motion needs it.

    Returns:
        Exponentials fitted to the simulator, and what is left between the two, by motion.

    Raises:
        ConvergenceError: A motion finds no equilibrium.
    """
    places = marker_places(grid)
    scenes, moved = [replace(scene, motion=motion) for motion in motions.values()], []
    for moving in scenes:
        path = path_for(moving, plan_effects(moving))
        surface = surface_state(path, follow(moving, path))
        moved.append(surface_displacement(surface, places)[:, :2])
    fitted = fit_fots(places, scenes, moved)
    found = {
        name: _compare(places, shift, fitted.displacement(places, moving), grid, geometry)
        for name, moving, shift in zip(motions, scenes, moved, strict=True)
    }
    return fitted, found


def _compare(
    places: FloatArray,
    moved: FloatArray,
    cheap: FloatArray,
    grid: MarkerGrid,
    geometry: CameraGeometry,
) -> MarkerComparison:
    difference = np.linalg.norm(cheap - moved, axis=1)
    rng = np.random.default_rng(0)
    plain = np.full((geometry.height, geometry.width, 3), _LEVEL, dtype=np.uint8)
    frames = []
    for at in (places, places + moved):
        image = draw_markers(plain, at, grid.radius_m, geometry)
        noisy = image + _NOISE_LEVELS * rng.standard_normal(image.shape)
        frames.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    markers = find_markers(frames[0])
    if markers is None:
        raise ConfigError(
            "the frame at rest shows no marker",
            remedy="check the sensor file's [markers] radius and pixel size",
        )
    tracks = follow_markers(markers, frames[1])
    which = cKDTree(places).query(geometry.to_pad(tracks.rest_px))[1]
    scale = (geometry.scale_x_m, geometry.scale_y_m)
    error = np.linalg.norm(tracks.motion_px - moved[which] / scale, axis=1)
    return MarkerComparison(
        largest_m=float(np.linalg.norm(moved, axis=1).max()),
        difference_rms_m=float(np.sqrt(np.mean(difference**2))),
        difference_largest_m=float(difference.max()),
        tracking_rms_px=float(np.sqrt(np.mean(error**2))) if len(error) else float("nan"),
        tracking_largest_px=float(error.max()) if len(error) else float("nan"),
        tracked=len(error),
        lost=tracks.lost,
    )
