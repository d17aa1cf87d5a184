"""What a tip does to the gel, tabulated over depth and kept in a cache by content.

``python -m drivers.emulators.plant.press_table`` computes again the tables that are shipped for the
dry run's cylinder (about a minute each).
"""

from __future__ import annotations

import bisect
import logging
import os
import zipfile
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from drivers.emulators.plant.quad_mesh import PressCase
from drivers.emulators.plant.tips import CylinderTip, Tip
from drivers.emulators.plant.truth import FRICTION, GelDisc
from tacauchy_rig.core.arrays import FloatArray

POISSON_STEPS = (0.47, 0.475, 0.48, 0.485, 0.49)
_TILT_KEY = "leaning"  # of ``tilt_displacement`` in the files
SHIPPED = Path(__file__).with_name("tables")
_DEEPEST_SHARE = 0.4  # of the gel's thickness

log = logging.getLogger(__name__)


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
    """Force and surface over depth; row 0 is the moment of contact."""

    depths: FloatArray  # tip below the gel's highest point [m], shape [depth_count]
    force: FloatArray  # over Young's modulus [m^2], shape [depth_count]
    stiffness: FloatArray  # slope of the cubic spline through the forces, over Young's modulus [m]
    contact_radius: FloatArray  # largest radius in contact [m], shape [depth_count]
    radius_rest: FloatArray  # where points of the surface lie at rest [m], shape [point_count]
    height_rest: FloatArray  # their height relative to the highest point [m]
    displacement: FloatArray  # their (u_r, u_z) [m], shape [depth_count, point_count, 2]
    # What a tilt of one radian adds to it on the side that the tip tilts to [m]; empty for a tip
    # without a face, as is what follows.
    tilt_displacement: FloatArray = field(default_factory=_nothing)
    # On the tip about its lowest point, over Young's modulus, against a tilt of one radian [m^3],
    # shape [depth_count].
    moment: FloatArray = field(default_factory=_nothing)
    # On the tip towards the side that it tilts to, likewise [m^2].
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
    """Press in steps and tabulate."""
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
