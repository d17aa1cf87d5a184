"""The settings whose accuracy and cost are compared."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from importlib import resources

from pydantic import TypeAdapter

from sim.mesh.elements import ElementOrder
from sim.scene.scene import Effect, Preset, Scene
from sim.solve.equilibrium import SolverOptions
from sim.studies.accuracy.force_limit import COARSENING


@dataclass(frozen=True, slots=True, kw_only=True)
class Configuration:
    """One way to simulate a press.

    Attributes:
        name: Short, for the figure and the table.
        preset: Whose mesh is taken.
        element: Linear or quadratic tetrahedra.
        finite_strain: Hyperelastic; else Hooke's law on the undeformed pad.
        barrier_m: d_hat [m]; None is the scene's choice.
        residual_relative: Where Newton ends, over the contact force's norm.
        refinement: Every edge this many times shorter than the preset's.
        device: Where the kernels run.
    """

    name: str
    preset: Preset
    element: ElementOrder = ElementOrder.P2
    finite_strain: bool = True
    barrier_m: float | None = None
    residual_relative: float = SolverOptions().residual_relative
    refinement: float = 1.0
    device: str = "cpu"

    @property
    def is_preset(self) -> bool:
        """The settings are exactly those that a user gets by the preset's name."""
        plain = Configuration(
            name=self.name,
            preset=self.preset,
            element=ElementOrder.P1 if self.preset is Preset.PAPER else ElementOrder.P2,
            device=self.device,
        )
        return self == plain

    def applied(self, scene: Scene) -> Scene:
        """Return the scene with these settings."""
        quadratic = self.element is ElementOrder.P2
        return replace(
            scene,
            preset=self.preset,
            barrier_m=self.barrier_m,
            effects=(
                *scene.effects,
                (Effect.LOCKING_FREE_ELEMENT, quadratic),
                (Effect.FINITE_STRAIN, self.finite_strain),
            ),
        )

    def refined(self, factor: float) -> Configuration:
        """Return the same settings with every edge so many times shorter."""
        return replace(self, refinement=self.refinement * factor)


def coarser(reference: Configuration) -> Configuration:
    """Return a reference's settings with edges 1.5 times as long, for its own error."""
    return replace(reference.refined(1.0 / COARSENING), name=f"{reference.name}, coarser")


_FILE = resources.files("sim.studies.accuracy").joinpath("configurations.toml")
SHORT, _LONG = (
    TypeAdapter(tuple[Configuration, ...]).validate_python(rows)
    for rows in tomllib.loads(_FILE.read_text("utf-8")).values()
)
FULL = (*SHORT, *_LONG)
REFERENCE = Configuration(name="reference", preset=Preset.REFERENCE)
# What is pressed on two more meshes; the finer ones would take longer than all of these.
SHIFTED = tuple(
    each
    for each in SHORT
    if (each.element is ElementOrder.P1 and each.preset is not Preset.PAPER)
    or each.name in ("fast / 4", "fast / 2", "fast")
)


def reseeded(configuration: Configuration, seed: int) -> Configuration:
    """Return the same settings on another mesh: edges shorter or longer by up to 7 %.

    The meshes of the presets are built, not drawn, so that a seed can only mean another size. The
    paper's mesh is the one that ships: fTetWild does not give the same one twice.
    """
    if seed == 0 or configuration.preset is Preset.PAPER:
        return configuration
    shift = ((0.618034 * seed) % 1.0 - 0.5) * 0.14
    return configuration.refined(1.0 + shift)
