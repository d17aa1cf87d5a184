"""What a tip does to the gel, tabulated over depth and kept in a cache by content.

``python -m drivers.emulators.plant.press_table`` computes again the tables that are shipped for
the dry run's cylinder (about a minute each).
"""

from __future__ import annotations

import hashlib
import logging
import os
import zipfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drivers.emulators.plant.arrays import FloatArray
from drivers.emulators.plant.axisymmetric import Equilibrium, GelSolver
from drivers.emulators.plant.leaning import Lean, lean_of
from drivers.emulators.plant.neo_hookean import NeoHookean
from drivers.emulators.plant.quad_mesh import GelDisc, Grading, QuadMesh, line_shape, mesh_disc
from drivers.emulators.plant.tips import CylinderTip, Tip
from drivers.emulators.plant.truth import FRICTION
from tacauchy_rig.errors import ConvergenceError

POISSON_STEPS = (0.47, 0.475, 0.48, 0.485, 0.49)

# Raise them when the solver's numbers change, so that old tables are not used: a ball's, a face's.
_SOLVER_VERSION, _FACE_VERSION = 1, 2
_SHIPPED = Path(__file__).with_name("tables")
_DEPTH_STEP_M = 4e-5
_FIRST_DEPTHS_M = (5e-6, 1e-5, 2e-5)
_POINTS_PER_EDGE = 4
_CUT_LIMIT = 3
_DEEPEST_SHARE = 0.4  # of the gel's thickness

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
        """The tip has a flat face, which may lean; a ball looks alike from all sides."""
        return isinstance(self.tip, CylinderTip)

    def file_name(self) -> str:
        """Return a name made from the content."""
        numbers = {name: value for name, value in asdict(self).items() if value != 0.0}
        version = _FACE_VERSION if self.has_face else _SOLVER_VERSION
        content = f"{version} {type(self.tip).__name__} {_rounded(numbers)}"
        digest = hashlib.sha256(content.encode()).hexdigest()[:16]
        return f"{type(self.tip).__name__.lower()}-{self.tip.diameter_m * 1e3:g}mm-{digest}.npz"


@dataclass(frozen=True, slots=True, kw_only=True)
class PressTable:
    """Force and surface over depth; row 0 is the moment of contact.

    Attributes:
        depths: Tip below the gel's highest point [m], shape [depth_count].
        force: Over Young's modulus [m^2], shape [depth_count].
        contact_radius: Largest radius in contact [m], shape [depth_count].
        radius_rest: Where points of the surface lie at rest [m], shape [point_count].
        height_rest: Their height relative to the highest point [m].
        displacement: Their (u_r, u_z) [m], shape [depth_count, point_count, 2].
        leaning: What a lean of one radian adds to it on the side that the tip leans to [m]; empty
            for a tip without a face, as is what follows.
        moment: On the tip about its lowest point, over Young's modulus, against a lean of one
            radian [m^3], shape [depth_count].
        side_force: On the tip towards the side that it leans to, likewise [m^2].
    """

    depths: FloatArray
    force: FloatArray
    contact_radius: FloatArray
    radius_rest: FloatArray
    height_rest: FloatArray
    displacement: FloatArray
    leaning: FloatArray = field(default_factory=lambda: np.zeros(0))
    moment: FloatArray = field(default_factory=lambda: np.zeros(0))
    side_force: FloatArray = field(default_factory=lambda: np.zeros(0))

    def save(self, path: Path) -> None:
        """Write the table so that readers never see half of it."""
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh = path.with_name(f".{os.getpid()}-{path.name}")
        with fresh.open("wb") as file:
            fields = ("displacement", "leaning")
            shortened = {name: getattr(self, name).astype(np.float32) for name in fields}
            np.savez_compressed(file, **(asdict(self) | shortened))
        fresh.replace(path)

    @classmethod
    def load(cls, path: Path) -> PressTable:
        """Read a table that ``save`` wrote."""
        with path.open("rb") as file, np.load(file) as content:
            return cls(**{name: content[name].astype(np.float64) for name in content.files})


def case_for(
    tip: Tip, poisson: float, *, gel: GelDisc | None = None, friction: float = 0.0
) -> PressCase:
    """Return the case of the emulated gel under ``tip``, as deep as presses on it go."""
    disc = gel or GelDisc()
    deepest_m = _DEEPEST_SHARE * disc.thickness_m
    depth_m = 1.0e-3 if isinstance(tip, CylinderTip) else min(1.5e-3, 0.32 * tip.diameter_m)
    depth_m = min(depth_m, deepest_m)
    return PressCase(tip=tip, gel=disc, poisson=poisson, max_depth_m=depth_m, friction=friction)


def press_table(case: PressCase) -> PressTable:
    """Return the table for ``case``: shipped, cached, or computed now and cached."""
    name = case.file_name()
    cached = cache_folder() / name
    for path in (_SHIPPED / name, cached):
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
    mesh = mesh_disc(case.gel, _grading(case))
    solver = GelSolver(mesh, NeoHookean(poisson=case.poisson), friction=case.friction)
    depth_count = round(case.max_depth_m / _DEPTH_STEP_M)
    regular = np.linspace(0.0, case.max_depth_m, depth_count + 1)[1:]
    depths = [depth for depth in _FIRST_DEPTHS_M if depth < 0.9 * regular[0]] + list(regular)
    solved = [0.0]
    states = [Equilibrium(displacement=np.zeros_like(mesh.nodes), force=0.0, contact_radius_m=0.0)]
    leans = [Lean(displacement=np.zeros_like(mesh.nodes), moment=0.0, side_force=0.0)]
    for depth in depths:
        try:
            states.append(_advance(solver, case, solved, states, float(depth)))
        except ConvergenceError:
            if depth < 0.5 * case.max_depth_m:
                raise
            break
        solved.append(float(depth))
        if case.has_face:
            leans.append(lean_of(solver, states[-1], case.tip, case.gel.thickness_m - float(depth)))
    sample = _surface_sampler(mesh)
    rest = sample(mesh.nodes)
    return PressTable(
        depths=np.array(solved),
        force=np.array([state.force for state in states]),
        contact_radius=np.array([state.contact_radius_m for state in states]),
        radius_rest=rest[:, 0],
        height_rest=rest[:, 1] - case.gel.thickness_m,
        displacement=np.stack([sample(state.displacement) for state in states]),
        **({} if not case.has_face else _leaning(leans, sample)),
    )


def _leaning(
    leans: list[Lean], sample: Callable[[FloatArray], FloatArray]
) -> dict[str, FloatArray]:
    """Return what is kept of the leans at all depths."""
    return {
        "leaning": np.stack([sample(lean.displacement) for lean in leans]),
        "moment": np.array([lean.moment for lean in leans]),
        "side_force": np.array([lean.side_force for lean in leans]),
    }


def _advance(
    solver: GelSolver,
    case: PressCase,
    solved: list[float],
    states: list[Equilibrium],
    depth: float,
) -> Equilibrium:
    """Go from the last solved depth to ``depth``, extrapolating first, then in smaller steps."""
    last, held = states[-1].displacement, states[-1].grip
    ahead = last
    if len(states) > 1:
        ratio = (depth - solved[-1]) / (solved[-1] - solved[-2])
        ahead = last + ratio * (last - states[-2].displacement)
    tries = [(ahead, 1), *((last, 2**cut) for cut in range(_CUT_LIMIT))]
    for state, step_count in tries:
        grip = held
        try:
            for z in np.linspace(solved[-1], depth, step_count + 1)[1:]:
                tip_z_m = case.gel.thickness_m - float(z)
                found = solver.press(case.tip, tip_z_m, state, grip=grip)
                state, grip = found.displacement, found.grip
        except ConvergenceError as error:
            failure = error
        else:
            return found
    raise failure


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


class _surface_sampler:  # noqa: N801 - used as a function
    """Evaluates a nodal field along the quadratic edges of the top."""

    def __init__(self, mesh: QuadMesh) -> None:
        points = np.linspace(-1.0, 1.0, _POINTS_PER_EDGE + 1)[:-1]
        self._shape, _ = line_shape(points)
        self._edges = mesh.top_edges

    def __call__(self, nodal: FloatArray) -> FloatArray:
        """Return values, shape [point_count, 2], from the axis outwards."""
        inner = np.einsum("qi,eia->eqa", self._shape, nodal[self._edges]).reshape(-1, 2)
        return np.vstack([inner, nodal[self._edges[-1, 2]]])


def main() -> None:
    """Compute the shipped tables again."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    for poisson in POISSON_STEPS:
        case = case_for(CylinderTip(diameter_m=5e-3), poisson, friction=FRICTION)
        compute_table(case).save(_SHIPPED / case.file_name())
        log.info("wrote %s (Poisson's ratio %g)", case.file_name(), poisson)


if __name__ == "__main__":
    main()
