"""The settings whose accuracy and cost are compared."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sim.mesh.elements import ElementOrder
from sim.scene.scene import Effect, Preset, Scene
from sim.solve.newton import NewtonOptions
from sim.studies.accuracy.force_limit import COARSENING

PAPER_BARRIER_M = 1e-3


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
    residual_relative: float = NewtonOptions().residual_relative
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


def coarser(reference: Configuration) -> Configuration:
    """Return a reference's settings with edges 1.5 times as long, for its own error."""
    return replace(
        reference,
        name=f"{reference.name}, coarser",
        refinement=reference.refinement / COARSENING,
    )


_FAST = Configuration(name="fast", preset=Preset.FAST)
_BALANCED = Configuration(name="balanced", preset=Preset.BALANCED)
_ACCURATE = Configuration(name="accurate", preset=Preset.ACCURATE)
_REFERENCE = Configuration(name="reference", preset=Preset.REFERENCE)
_PAPER = Configuration(name="paper", preset=Preset.PAPER, element=ElementOrder.P1)

SHORT_REFERENCE = _ACCURATE
FULL_REFERENCE = _REFERENCE

SHORT: tuple[Configuration, ...] = (
    _PAPER,
    replace(_PAPER, name="paper, d_hat 1 mm", barrier_m=PAPER_BARRIER_M),
    replace(_FAST, name="fast, P1", element=ElementOrder.P1),
    replace(_ACCURATE, name="accurate, P1", element=ElementOrder.P1),
    replace(_FAST, name="fast / 4", refinement=0.25),
    replace(_FAST, name="fast / 2", refinement=0.5),
    replace(_FAST, name="fast / 2, linear", refinement=0.5, finite_strain=False),
    _FAST,
    replace(_FAST, name="fast, linear", finite_strain=False),
    replace(_FAST, name="fast, d_hat 10 um", barrier_m=1e-5),
    replace(_FAST, name="fast, d_hat 50 um", barrier_m=5e-5),
    replace(_FAST, name="fast, residual 1e-4", residual_relative=1e-4),
    replace(_BALANCED, name="balanced / 1.13", refinement=1.0 / 1.13),
    _BALANCED,
    _ACCURATE,
)
"""At least twelve, in less than three minutes on two cores."""

SHIFTED: tuple[Configuration, ...] = (
    *(
        each
        for each in SHORT
        if each.element is ElementOrder.P1 and each.preset is not Preset.PAPER
    ),
    replace(_FAST, name="fast / 4", refinement=0.25),
    replace(_FAST, name="fast / 2", refinement=0.5),
    _FAST,
)
"""What is pressed on two more meshes; the finer ones would take longer than all of these."""

FULL: tuple[Configuration, ...] = (
    *SHORT,
    _REFERENCE,
    replace(_PAPER, name="paper, P2", element=ElementOrder.P2),
    replace(_BALANCED, name="balanced, P1", element=ElementOrder.P1),
    replace(_FAST, name="fast / 3", refinement=1.0 / 3.0),
    replace(_FAST, name="fast / 4, linear", refinement=0.25, finite_strain=False),
    replace(_FAST, name="fast / 2, d_hat 10 um", refinement=0.5, barrier_m=1e-5),
    replace(_FAST, name="fast x 1.5", refinement=1.5),
    replace(_FAST, name="fast x 2", refinement=2.0),
    replace(_BALANCED, name="balanced, linear", finite_strain=False),
    replace(_BALANCED, name="balanced, d_hat 10 um", barrier_m=1e-5),
    replace(_BALANCED, name="balanced x 1.5", refinement=1.5),
    replace(_ACCURATE, name="accurate / 1.5", refinement=1.0 / 1.5),
    replace(_ACCURATE, name="accurate, linear", finite_strain=False),
    replace(_ACCURATE, name="accurate, d_hat 10 um", barrier_m=1e-5),
    replace(_ACCURATE, name="accurate, residual 1e-4", residual_relative=1e-4),
)
"""The rest, for an hour that nobody waits for."""


def reseeded(configuration: Configuration, seed: int) -> Configuration:
    """Return the same settings on another mesh: edges shorter or longer by up to 7 %.

    The meshes of the presets are built, not drawn, so that a seed can only mean another size. The
    paper's mesh is the one that ships: fTetWild does not give the same one twice.
    """
    if seed == 0 or configuration.preset is Preset.PAPER:
        return configuration
    shift = ((0.618034 * seed) % 1.0 - 0.5) * 0.14
    return replace(configuration, refinement=configuration.refinement * (1.0 + shift))
