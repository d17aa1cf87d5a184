"""What a tip does to the gel, tabulated over depth and kept in a cache by content.

``python -m drivers.emulators.plant.press_table`` computes again the tables that are shipped for the
dry run's cylinder (about a minute each).
"""

from __future__ import annotations

import bisect
import hashlib
import logging
import os
import zipfile
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drivers.emulators.plant.tips import CylinderTip, Tip
from drivers.emulators.plant.truth import FRICTION, GelDisc
from tacauchy_rig.core.arrays import FloatArray

POISSON_STEPS = (0.47, 0.475, 0.48, 0.485, 0.49)
SHIPPED = Path(__file__).with_name("tables")
_TILT_KEY = "leaning"  # of ``tilt_displacement`` in the files
_DEEPEST_SHARE = 0.4  # of the gel's thickness
# Raise them when the numbers or the fields change, so that old tables are not used: a ball's, a
# face's.
_BALL_VERSION, _FACE_VERSION = 2, 3

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class PressCase:
    """Everything a table depends on. Young's modulus is not here: forces scale with it.

    Attributes:
        friction: Coulomb coefficient between tip and gel.
        max_depth_m: Depth of the last row asked for [m]; a table may end a little earlier where
            the gel finds no equilibrium any more.
    """

    tip: Tip = field(default_factory=lambda: CylinderTip(diameter_m=5e-3))
    gel: GelDisc = field(default_factory=GelDisc)
    poisson: float = 0.48
    max_depth_m: float = 1.0e-3
    friction: float = 0.0

    @property
    def has_face(self) -> bool:
        """The tip has a flat face, which may be tilted; a ball looks alike from all sides."""
        return isinstance(self.tip, CylinderTip)

    def file_name(self) -> str:
        """Return a name made from the content."""
        numbers = {name: value for name, value in asdict(self).items() if value != 0.0}
        version = _FACE_VERSION if self.has_face else _BALL_VERSION
        content = f"{version} {type(self.tip).__name__} {_rounded(numbers)}"
        digest = hashlib.sha256(content.encode()).hexdigest()[:16]
        return f"{type(self.tip).__name__.lower()}-{self.tip.diameter_m * 1e3:g}mm-{digest}.npz"


def _rounded(values: dict[str, Any]) -> list[tuple[str, Any]]:
    """Return the items in order, with digits that survive a round trip through text."""
    found: list[tuple[str, Any]] = []
    for name, value in sorted(values.items()):
        if isinstance(value, dict):
            found.append((name, _rounded(value)))
        elif not isinstance(value, tuple):
            found.append((name, f"{value:.9g}"))
        elif value:  # a gel of one material has the name it had before there were layers
            found.append((name, [f"{share:.9g} {ratio:.9g}" for share, ratio in value]))
    return found


def case_for(
    tip: Tip, poisson: float, *, gel: GelDisc | None = None, friction: float = 0.0
) -> PressCase:
    """Return the case of the emulated gel under ``tip``, as deep as presses on it go."""
    disc = gel or GelDisc()
    depth_m = 1.0e-3 if isinstance(tip, CylinderTip) else min(1.5e-3, 0.32 * tip.diameter_m)
    depth_m = min(depth_m, _DEEPEST_SHARE * disc.thickness_m)
    return PressCase(tip=tip, gel=disc, poisson=poisson, max_depth_m=depth_m, friction=friction)


def _nothing() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PressTable:
    """Force and surface over depth; row 0 is the moment of contact.

    Attributes:
        depths: Tip below the gel's highest point [m], shape [depth_count].
        force: Over Young's modulus [m^2], shape [depth_count].
        stiffness: Slope of the cubic spline through the forces, over Young's modulus [m].
        contact_radius: Largest radius in contact [m], shape [depth_count].
        radius_rest: Where points of the surface lie at rest [m], shape [point_count].
        height_rest: Their height relative to the highest point [m].
        displacement: Their (u_r, u_z) [m], shape [depth_count, point_count, 2].
        tilt_displacement: What a tilt of one radian adds to it on the side that the tip tilts to
            [m]; empty for a tip without a face, as is what follows.
        moment: On the tip about its lowest point, over Young's modulus, against a tilt of one
            radian [m^3], shape [depth_count].
        side_force: On the tip towards the side that it tilts to, likewise [m^2].
    """

    depths: FloatArray
    force: FloatArray
    stiffness: FloatArray
    contact_radius: FloatArray
    radius_rest: FloatArray
    height_rest: FloatArray
    displacement: FloatArray
    tilt_displacement: FloatArray = field(default_factory=_nothing)
    moment: FloatArray = field(default_factory=_nothing)
    side_force: FloatArray = field(default_factory=_nothing)

    def at(self, depth: float) -> tuple[float, float]:
        """Return force [m^2] and stiffness [m] at a depth of the table, over Young's modulus.

        By hand, because it runs every cycle of an emulated arm and of an emulated sensor: with
        slopes that are kept, the spline is a cubic polynomial between two depths.
        """
        row = min(max(bisect.bisect_right(self.depths, depth) - 1, 0), len(self.depths) - 2)
        start, end = self.force[row : row + 2].tolist()
        first, last = self.stiffness[row : row + 2].tolist()
        low, high = self.depths[row : row + 2].tolist()
        span = high - low
        t = (depth - low) / span
        mean = (end - start) / span
        bend = first + last - 2.0 * mean
        skew = 3.0 * mean - 2.0 * first - last
        force = start + span * t * (first + t * (skew + t * bend))
        return force, first + t * (2.0 * skew + 3.0 * t * bend)

    def save(self, path: Path) -> None:
        """Write the table so that readers never see half of it."""
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh = path.with_name(f".{os.getpid()}-{path.name}")
        content = asdict(self)
        content["displacement"] = self.displacement.astype(np.float32)
        content[_TILT_KEY] = content.pop("tilt_displacement").astype(np.float32)
        with fresh.open("wb") as file:
            np.savez_compressed(file, **content)
        fresh.replace(path)

    @classmethod
    def load(cls, path: Path) -> PressTable:
        """Read a table that ``save`` wrote."""
        with path.open("rb") as file, np.load(file) as content:
            fields = {name: content[name].astype(np.float64) for name in content.files}
        if _TILT_KEY in fields:
            fields["tilt_displacement"] = fields.pop(_TILT_KEY)
        return cls(**fields)


def press_table(case: PressCase) -> PressTable:
    """Return the table for ``case``: shipped, cached, or computed now and cached.

    Raises:
        ConvergenceError: No equilibrium was found in the first half of the depth asked for.
    """
    name = case.file_name()
    cached = cache_folder() / name
    for path in (SHIPPED / name, cached):
        try:
            return PressTable.load(path)
        except FileNotFoundError:
            continue
        except (ValueError, KeyError, TypeError, OSError, zipfile.BadZipFile) as error:
            log.warning("press table %s is damaged and will be computed again: %s", path, error)
    log.info("computing the press table %s", name)
    table = compute_table(case)
    try:
        table.save(cached)
    except OSError as error:
        log.warning("press table %s could not be kept: %s", cached, error)
    return table


def cache_folder() -> Path:
    """Return where computed tables are kept: under XDG_CACHE_HOME or ``~/.cache``."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "tacauchy-rig" / "press-tables"


def compute_table(case: PressCase) -> PressTable:
    """Press in steps and tabulate.

    Raises:
        ConvergenceError: No equilibrium was found in the first half of the depth asked for.
    """
    from drivers.emulators.plant.tabulation import tabulate  # noqa: PLC0415 - scipy, for new tips

    return PressTable(**tabulate(case))


def main() -> None:
    """Compute the shipped tables again."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    for poisson in POISSON_STEPS:
        case = case_for(CylinderTip(diameter_m=5e-3), poisson, friction=FRICTION)
        compute_table(case).save(SHIPPED / case.file_name())
        log.info("wrote %s (Poisson's ratio %g)", case.file_name(), poisson)


if __name__ == "__main__":
    main()
