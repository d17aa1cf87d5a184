"""Do indenter, clamp and load carry the same force, and does the surface's stress?"""

from __future__ import annotations

from dataclasses import dataclass, replace

from sim.effects.presets import build_model
from sim.press import press
from sim.press_command import scene_from
from sim.scene.material import Layer, Material
from sim.scene.scene import Scene
from sim.studies.verification.prose import stated
from tacauchy_rig.tables import Table, table_of

_LIMIT = 1e-6
REFINEMENTS = (1.0, 1.5)
_GEL = "--pad box:20x24x4mm --young 0.4MPa --poisson 0.48 --preset fast"
_PRESSES = {
    "sharp punch to a depth": "--indenter cylinder:diameter=5mm --depth 0.2mm",
    "sharp punch to a load": "--indenter cylinder:diameter=5mm --force 1N",
    "filleted punch to a load": "--indenter cylinder:diameter=5mm,fillet=0.1mm --force 1N",
    "ball to a load": "--indenter sphere:diameter=8mm --force 0.4N",
    "bonded ball": "--indenter sphere:diameter=8mm --depth 0.2mm --contact bonded",
    "ball with friction 0.5": "--indenter sphere:diameter=8mm --depth 0.2mm "
    "--contact friction:0.5 --effect friction=on",
}
_SCENES = {name: scene_from(f"{_GEL} {words}") for name, words in _PRESSES.items()}
_SCENES["ball on two layers"] = replace(
    scene_from(f"{_GEL} --indenter sphere:diameter=8mm --depth 0.2mm"),
    layers=(
        Layer(share=0.75, material=Material(young_pa=1e5, poisson=0.46)),
        Layer(share=0.25, material=Material(young_pa=4e5, poisson=0.46)),
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class BalancedPress:
    """The force of one press, counted in four ways.

    Attributes:
        force_n: On the indenter [N].
        base_relative: |force + base reaction| over the force.
        load_relative: |force - load| over the load; None where a depth was asked for.
        traction_gaps: surface_traction_gap_relative on meshes of ``REFINEMENTS``.
        gap_min_m: Smallest gap [m], over both meshes.
    """

    name: str
    force_n: float
    base_relative: float
    load_relative: float | None
    traction_gaps: tuple[float, ...]
    gap_min_m: float

    @property
    def is_balanced(self) -> bool:
        """Indenter, base and load agree to 1e-6, and nothing overlaps."""
        return max(self.base_relative, self.load_relative or 0.0) < _LIMIT and self.gap_min_m > 0.0


def balanced_press(name: str, scene: Scene) -> BalancedPress:
    """Press a scene on its own mesh and on a finer one."""
    results = [press(scene, model=build_model(scene, refinement=factor)) for factor in REFINEMENTS]
    load = scene.target.force_n
    return BalancedPress(
        name=name,
        force_n=results[0].force_n[2],
        base_relative=max(result.force_balance_relative for result in results),
        load_relative=None
        if load is None
        else max(abs(result.force_n[2] / load - 1.0) for result in results),
        traction_gaps=tuple(result.surface_traction_gap_relative for result in results),
        gap_min_m=min(result.gap_min_m for result in results),
    )


def measure() -> Table:
    """Press the scenes and compare."""
    found = [balanced_press(name, scene) for name, scene in _SCENES.items()]
    worst = [max(row.traction_gaps[k] for row in found) for k in range(len(REFINEMENTS))]
    gap = "surface_traction_gap_relative, edges 1/"
    return table_of(
        found,
        {
            "press": lambda row: row.name,
            "F_z [N]": lambda row: row.force_n,
            "indenter and base": lambda row: row.base_relative,
            "indenter and load": lambda row: row.load_relative,
            f"{gap}{REFINEMENTS[0]:g}": lambda row: row.traction_gaps[0],
            f"{gap}{REFINEMENTS[1]:g}": lambda row: row.traction_gaps[1],
            "smallest gap [um]": lambda row: row.gap_min_m * 1e6,
        },
        **stated("balance", worst=worst),
        passed=all(row.is_balanced for row in found) and worst[-1] < worst[0],
        command="tacauchy-rig press --pad box:20x24x4mm --young 0.4MPa --poisson 0.48 "
        "--indenter cylinder:diameter=5mm --force 1N --preset fast",
    )
