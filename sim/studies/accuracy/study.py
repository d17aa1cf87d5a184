"""Errors of many configurations against one reference whose own error is shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from sim.force_error_estimate import error_order
from sim.optics.camera_geometry import CameraGeometry, ImageArray
from sim.optics.height.height_map import HeightMaps
from sim.scene.scene import Preset, Scene
from sim.studies.accuracy.configurations import Configuration, coarser
from sim.studies.accuracy.force_limit import COARSENING, extrapolated
from sim.studies.accuracy.mesh_chance import (
    MeasuredChance,
    MeshKey,
    chance_of,
    chances,
    mesh_key,
    neighbours,
)
from sim.studies.accuracy.observation import Observation, height_error, observe
from tacauchy_rig.errors import RigError

QUANTITIES = ("force", "depth", "pressure", "radius", "height", "image")
_ORDER_LOW = 1.0

Render = Callable[[HeightMaps], ImageArray]
Similarity = Callable[[ImageArray, ImageArray, HeightMaps], tuple[float, float]]
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A configuration's errors and cost.

    Attributes:
        errors: By quantity: relative errors, with their sign, of F_z at the reference's depth, and
            of depth, largest pressure and contact radius at the force; RMS error of the height over
            the deepest indentation; 1 - SSIM of the image.
        chances: By quantity: how far its error may be off for what its mesh happens to cut.
        zncc_contact: Correlation with the reference's image inside the contact.
        on_front: No configuration that is at least as fast is closer in F_z.
        failure: Why there are no numbers; empty otherwise.
    """

    configuration: Configuration
    errors: dict[str, float] = field(default_factory=dict)
    chances: dict[str, float] = field(default_factory=dict)
    zncc_contact: float = np.nan
    setup_s: float = np.nan
    solve_s: float = np.nan
    cpu_s: float = np.nan
    steps: int = 0
    newton_iterations: int = 0
    tet_count: int = 0
    node_count: int = 0
    on_front: bool = False
    failure: str = ""

    @property
    def wall_s(self) -> float:
        """Set-up and solve [s]."""
        return self.setup_s + self.solve_s

    @property
    def time_s(self) -> float:
        """Set-up and solve, without what they waited for a processor that others used [s]."""
        if self.configuration.device != "cpu":
            return self.wall_s
        return min(self.wall_s, self.cpu_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """What accuracy costs for one scene.

    Attributes:
        bars: By quantity: how far the reference itself may be from the limit.
        rows: In the order in which they were asked for.
        reference: The reference's own cost.
    """

    bars: dict[str, float]
    rows: tuple[Row, ...]
    reference: Row


def study(
    scene: Scene,
    configurations: Sequence[Configuration],
    geometry: CameraGeometry,
    *,
    render: Render,
    similarity: Similarity,
    reference: Configuration,
    shifted: Sequence[Configuration] = (),
    on_progress: Progress = lambda _text: None,
) -> Study:
    """Measure every configuration against a reference.

    F_z and depth are compared with the limit that the reference and the same on edges 1.5 times as
    long tend to (Richardson, at order 2, or 1 under a sharp rim), half of what was extrapolated
    being its bar. Everything else is compared with the reference itself, whose bar is what order 1
    would leave, which is too much where the contact is smooth.

    Args:
        scene: A press to a force.
        render: Turns height maps into the tactile image.
        similarity: SSIM of two images, and their correlation inside the contact.
        reference: What is most exact.
        shifted: Settings that are pressed on two more meshes, for what a mesh happens to cut.

    Raises:
        ConvergenceError: The reference cannot be pressed.
    """
    _warm_up(scene, (reference, *configurations), geometry)
    on_progress(f"{reference.name}, which is the reference")
    exact = observe(scene, reference, geometry)
    on_progress("the reference on a coarser mesh, for its own error")
    coarse = observe(scene, coarser(reference), geometry)
    judge = _Judge(exact, coarse, render, similarity, order=error_order(scene))
    rows = []
    for configuration in configurations:
        if configuration == reference:
            rows.append(judge.row(exact))
            continue
        on_progress(configuration.name)
        rows.append(_row(scene, configuration, geometry, judge))
    on_progress("some of them on shorter and longer edges, for what a mesh happens to cut")
    known = _measured_chances(scene, [row for row in rows if row.errors], shifted, geometry, judge)
    rows = [replace(row, chances=chances(row.configuration, row.errors, known)) for row in rows]
    return Study(bars=judge.bars, rows=_with_front(rows), reference=judge.row(exact))


def _measured_chances(
    scene: Scene,
    rows: Sequence[Row],
    shifted: Sequence[Configuration],
    geometry: CameraGeometry,
    judge: _Judge,
) -> dict[MeshKey, MeasuredChance]:
    found: dict[MeshKey, MeasuredChance] = {}
    for row in rows:
        if row.configuration not in shifted:
            continue
        with suppress(RigError):
            others = [
                judge.errors(observe(scene, other, geometry))[0]
                for other in neighbours(row.configuration)
            ]
            found[mesh_key(row.configuration)] = MeasuredChance(
                row.errors, chance_of(row.errors, others), row.tet_count
            )
    return found


def _warm_up(
    scene: Scene, configurations: Sequence[Configuration], geometry: CameraGeometry
) -> None:
    """Compile every kernel that will be timed, on a mesh that costs next to nothing."""
    small = Configuration(name="warm-up", preset=Preset.FAST, refinement=0.25)
    kinds = {(c.element, c.finite_strain, c.device) for c in configurations}
    for element, finite_strain, device in sorted(kinds):
        kind = replace(small, element=element, finite_strain=finite_strain, device=device)
        with suppress(RigError):
            observe(scene, kind, geometry)


class _Judge:
    """Compares observations with the reference.

    Attributes:
        bars: By quantity: how far what is compared with may be from the truth.
    """

    def __init__(
        self,
        exact: Observation,
        coarse: Observation,
        render: Render,
        similarity: Similarity,
        *,
        order: float,
    ) -> None:
        self._exact = exact
        self._render = render
        self._similarity = similarity
        self._image = render(exact.maps)
        self._force, self._depth = exact.force_n, exact.depth_m
        drift, _ = self.errors(coarse)
        first = 1.0 / (COARSENING**_ORDER_LOW - 1.0)
        force = extrapolated(self._force, (1.0 + drift["force"]) * self._force, order=order)
        depth = extrapolated(self._depth, coarse.depth_m, order=order)
        self._force, self._depth = force.force_n, depth.force_n
        self.bars = {name: first * abs(error) for name, error in drift.items()}
        self.bars |= {"force": force.doubt, "depth": depth.doubt}

    def errors(self, found: Observation) -> tuple[dict[str, float], float]:
        """Return the errors by quantity, and the image's correlation inside the contact."""
        exact = self._exact
        ssim, zncc = self._similarity(self._image, self._render(found.maps), exact.maps)
        force = found.force_n if found is exact else found.force_at(exact.depth_m)
        return {
            "force": _relative(force, self._force),
            "depth": _relative(found.depth_m, self._depth),
            "pressure": _relative(found.pressure_max_pa, exact.pressure_max_pa),
            "radius": _relative(found.contact_radius_m, exact.contact_radius_m),
            "height": height_error(found.maps, exact.maps),
            "image": 1.0 - ssim,
        }, zncc

    def row(self, found: Observation) -> Row:
        """Return an observation's errors and cost."""
        errors, zncc = self.errors(found)
        return Row(
            configuration=found.configuration,
            errors=errors,
            zncc_contact=zncc,
            setup_s=found.setup_s,
            solve_s=found.solve_s,
            cpu_s=found.cpu_s,
            steps=found.steps,
            newton_iterations=found.newton_iterations,
            tet_count=found.tet_count,
            node_count=found.node_count,
        )


def _row(
    scene: Scene, configuration: Configuration, geometry: CameraGeometry, judge: _Judge
) -> Row:
    try:
        return judge.row(observe(scene, configuration, geometry))
    except RigError as error:
        return Row(configuration=configuration, failure=error.message)


def _with_front(rows: Sequence[Row]) -> tuple[Row, ...]:
    front = front_of([(row.time_s, abs(row.errors.get("force", np.nan))) for row in rows])
    return tuple(replace(row, on_front=on) for row, on in zip(rows, front, strict=True))


def front_of(points: Sequence[tuple[float, float]]) -> list[bool]:
    """Return which (cost, error) points no other point beats in both; NaN is never on the front."""
    return [
        bool(np.isfinite(cost) and np.isfinite(error))
        and not any((c <= cost and e <= error and (c < cost or e < error)) for c, e in points)
        for cost, error in points
    ]


def error_bar(reference_bar: float, error: float, chance: float) -> float:
    """Return how far an error may be off: the reference's own part, and what its mesh may cut.

    Args:
        reference_bar: Of what it is relative to.
        chance: How much the error differs on other meshes of about its size.
    """
    return (1.0 + abs(error)) * reference_bar + chance


def _relative(found: float, exact: float) -> float:
    return found / exact - 1.0
