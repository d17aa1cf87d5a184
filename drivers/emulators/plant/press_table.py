"""What a tip does to the gel, tabulated over depth and kept in a cache by content.

``python -m drivers.emulators.plant.press_table`` computes again the tables that are shipped for the
dry run's cylinder (about a minute each).
"""

from __future__ import annotations

import bisect
import hashlib
import io
import logging
import os
import zipfile
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.emulators.plant.quad_mesh import Grading, QuadMesh, line_shape, mesh_disc
from drivers.emulators.plant.truth import FRICTION, CylinderTip, GelDisc, Tip
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConvergenceError, RecordError
from tacauchy_rig.core.store.atomic_write import write_atomically

if TYPE_CHECKING:
    from drivers.emulators.plant.axisymmetric_fem import Equilibrium, GelSolver

POISSON_STEPS = (0.47, 0.475, 0.48, 0.485, 0.49)
_TILT_KEY = "leaning"  # of ``tilt_displacement`` in the files
SHIPPED = Path(__file__).with_name("tables")
_DEEPEST_SHARE = 0.4  # of the gel's thickness

_DEPTH_STEP_M = 4e-5
_FIRST_DEPTHS_M = (5e-6, 1e-5, 2e-5)
_POINTS_PER_EDGE = 4
_CUT_LIMIT = 3

log = logging.getLogger(__name__)


# Raise them when the numbers or the fields change, so that old tables are not used: a ball's, a
# face's.
_BALL_VERSION, _FACE_VERSION = 3, 4


@dataclass(frozen=True, slots=True, kw_only=True)
class PressCase:
    """Everything a table depends on. Young's modulus is not here: forces scale with it."""

    tip: Tip = field(default_factory=lambda: CylinderTip(diameter_m=5e-3))
    gel: GelDisc = field(default_factory=GelDisc)
    poisson: float = 0.48
    # Depth of the last row asked for [m]; a table may end a little earlier where the gel finds no
    # equilibrium any more.
    max_depth_m: float = 1.0e-3
    friction: float = 0.0  # Coulomb coefficient between tip and gel

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
    tilt_displacement: FloatArray
    # On the tip about its lowest point, over Young's modulus, against a tilt of one radian [m^3],
    # shape [depth_count].
    moment: FloatArray
    # On the tip towards the side that it tilts to, likewise [m^2].
    side_force: FloatArray

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
        content = asdict(self)
        content["displacement"] = self.displacement.astype(np.float32)
        content[_TILT_KEY] = content.pop("tilt_displacement").astype(np.float32)
        packed = io.BytesIO()
        np.savez_compressed(packed, **content)
        write_atomically(path, packed.getvalue())

    @classmethod
    def load(cls, path: Path) -> PressTable:
        """Read a table that ``save`` wrote."""
        with path.open("rb") as file, np.load(file) as content:
            fields = {name: content[name].astype(np.float64) for name in content.files}
        if _TILT_KEY in fields:
            fields["tilt_displacement"] = fields.pop(_TILT_KEY)
        absent = dict.fromkeys(("tilt_displacement", "moment", "side_force"), np.zeros(0))
        return cls(**(absent | fields))


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
    except RecordError as error:
        log.warning("press table %s could not be kept: %s", cached, error)
    return table


def cache_folder() -> Path:
    """Return where computed tables are kept: under XDG_CACHE_HOME or ``~/.cache``."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "tacauchy-rig" / "press-tables"


def compute_table(case: PressCase) -> PressTable:
    """Press in steps and tabulate."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - scipy, for new tips

    from drivers.emulators.plant.axisymmetric_fem import (  # noqa: PLC0415 - likewise
        Equilibrium,
        GelSolver,
        TiltResponse,
        tilt_response,
    )

    mesh, top_m = mesh_disc(case.gel, _grading(case)), case.gel.thickness_m
    solver = GelSolver(mesh, case.tip, poisson=case.poisson, friction=case.friction)
    depth_count = round(case.max_depth_m / _DEPTH_STEP_M)
    regular = np.linspace(0.0, case.max_depth_m, depth_count + 1)[1:].tolist()
    solved = [0.0]
    states = [Equilibrium(displacement=np.zeros_like(mesh.nodes))]
    tilts = [TiltResponse(displacement=np.zeros_like(mesh.nodes))]
    for depth in [*(first for first in _FIRST_DEPTHS_M if first < 0.9 * regular[0]), *regular]:
        try:
            states.append(_advance(solver, top_m, solved, states, depth))
        except ConvergenceError:
            if depth < 0.5 * case.max_depth_m:
                raise
            break
        solved.append(depth)
        if case.has_face:
            tilts.append(tilt_response(solver, states[-1]))
    tilts = tilts if case.has_face else []
    rest = _on_surface(mesh, mesh.nodes)
    force = np.array([state.force for state in states])
    return PressTable(
        depths=np.array(solved),
        force=force,
        stiffness=CubicSpline(solved, force)(solved, 1),
        contact_radius=np.array([state.contact_radius_m for state in states]),
        radius_rest=rest[:, 0],
        height_rest=rest[:, 1] - top_m,
        displacement=np.stack([_on_surface(mesh, each.displacement) for each in states]),
        tilt_displacement=np.array([_on_surface(mesh, each.displacement) for each in tilts]),
        moment=np.array([tilt.moment for tilt in tilts]),
        side_force=np.array([tilt.side_force for tilt in tilts]),
    )


def _advance(
    solver: GelSolver, top_m: float, solved: list[float], states: list[Equilibrium], depth: float
) -> Equilibrium:
    """Go from the last solved depth to ``depth``, extrapolating first, then in smaller steps."""
    last = ahead = states[-1].displacement
    if len(states) > 1:
        ratio = (depth - solved[-1]) / (solved[-1] - solved[-2])
        ahead = last + ratio * (last - states[-2].displacement)
    tries = [(ahead, 1), *((last, 2**cut) for cut in range(_CUT_LIMIT))]
    for start, step_count in tries:
        state, grip = start, states[-1].grip
        try:
            for step_depth in np.linspace(solved[-1], depth, step_count + 1)[1:].tolist():
                found = solver.press(top_m - step_depth, state, grip=grip)
                state, grip = found.displacement, found.grip
        except ConvergenceError as error:
            failure = error
        else:
            return found
    raise failure


def _grading(case: PressCase) -> Grading:
    if isinstance(case.tip, CylinderTip):
        rim = 0.5 * case.tip.diameter_m
        return Grading(
            fine_from_m=rim - min(0.4e-3 * case.max_depth_m / 1e-3, 0.6 * rim),
            fine_to_m=rim + 5e-5,
            fine_size_m=max(0.3 * case.tip.fillet_m, 2.5e-5),
        )
    reach = min(np.sqrt(case.tip.diameter_m * case.max_depth_m), 0.5 * case.tip.diameter_m)
    return Grading(
        fine_from_m=0.0, fine_to_m=1.1 * reach, fine_size_m=reach / 18, top_size_m=reach / 14
    )


def _on_surface(mesh: QuadMesh, nodal: FloatArray) -> FloatArray:
    """Return a nodal field along the quadratic edges of the top, axis outwards."""
    shape, _ = line_shape(np.linspace(-1.0, 1.0, _POINTS_PER_EDGE + 1)[:-1])
    inner = np.einsum("qi,eia->eqa", shape, nodal[mesh.top_edges])
    return np.vstack([inner.reshape(-1, 2), nodal[mesh.top_edges[-1, 2]]])


def main() -> None:
    """Compute the shipped tables again."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    for poisson in POISSON_STEPS:
        case = case_for(CylinderTip(diameter_m=5e-3), poisson, friction=FRICTION)
        compute_table(case).save(SHIPPED / case.file_name())
        log.info("wrote %s (Poisson's ratio %g)", case.file_name(), poisson)


if __name__ == "__main__":
    main()
