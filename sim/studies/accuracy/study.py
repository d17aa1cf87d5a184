"""Errors of many configurations against one reference whose own error is shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from sim.optics.height.height_map import HeightMaps
from sim.scene.scene import Preset, Scene
from sim.sensor.camera_geometry import CameraGeometry
from sim.studies.accuracy.configurations import Configuration, coarser
from sim.studies.accuracy.force_limit import COARSENING, error_order, extrapolated
from sim.studies.accuracy.observation import Observation, Row, height_error, observe
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import RigError

QUANTITIES = ("force", "depth", "pressure", "radius", "height", "image")
_ORDER_LOW = 1.0
EDGE_SHIFT = 0.07
# What finer meshes, on which nothing was measured, may have of an error for their chance.
_SHARE_MIN, _SHARE_MAX = 0.25, 1.0

Errors = Mapping[str, float]

Render = Callable[[HeightMaps], ImageArray]
Similarity = Callable[[ImageArray, ImageArray, HeightMaps], tuple[float, float]]
Progress = Callable[[str], None]


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
    would leave, which is too much where the contact is smooth: the larger of what that reference
    and the same on edges 2.25 times as long tell, since two meshes may agree by chance.

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
    coarsest = observe(scene, coarser(coarser(reference)), geometry)
    judge = _Judge(exact, (coarse, coarsest), render, similarity, order=error_order(scene))
    rows = []
    for configuration in configurations:
        if configuration == reference:
            rows.append(judge.row(exact))
            continue
        on_progress(configuration.name)
        try:
            rows.append(judge.row(observe(scene, configuration, geometry)))
        except RigError as error:
            rows.append(Row(configuration=configuration, failure=error.message))
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
) -> list[Row]:
    """Return the rows of the shifted settings with their chances, measured on other meshes."""
    found: list[Row] = []
    # On edges longer, and shorter, by as much as a seed may make them.
    for row in (row for row in rows if row.configuration in shifted):
        with suppress(RigError):
            others = [
                judge.errors(observe(scene, other, geometry))[0]
                for other in map(row.configuration.refined, (1.0 - EDGE_SHIFT, 1.0 + EDGE_SHIFT))
            ]
            found.append(replace(row, chances=chance_of(row.errors, others)))
    return found


def chance_of(own: Errors, others: Sequence[Errors]) -> dict[str, float]:
    """Return by quantity the largest difference of an error from its own on other meshes."""
    return {name: max(abs(other[name] - error) for other in others) for name, error in own.items()}


def chances(
    configuration: Configuration, errors: Errors, measured: Sequence[Row]
) -> dict[str, float]:
    """Return the chance of a configuration's errors.

    That of its own mesh and element where it was measured; else the share of the error that it has
    on the finest mesh with such an element, between a quarter and all of it. The paper's mesh is
    but one and has none.

    Args:
        measured: What was found on the meshes that were shifted.
    """
    if configuration.preset is Preset.PAPER:
        return dict.fromkeys(errors, 0.0)
    alike = [row for row in measured if row.configuration.element is configuration.element]
    same = next((row for row in alike if _has_mesh_of(row.configuration, configuration)), None)
    near = same or max(alike, key=lambda row: row.tet_count, default=None)
    scaled = {name: _share(near, name) * abs(error) for name, error in errors.items()}
    if same is None:
        return scaled
    return {name: max(same.chances[name], scaled[name]) for name in errors}


def _has_mesh_of(one: Configuration, other: Configuration) -> bool:
    return (one.preset, one.refinement) == (other.preset, other.refinement)


def _share(near: Row | None, name: str) -> float:
    """Return the chance of an error over its size, as far as a finer mesh may have it."""
    if near is None or near.errors[name] == 0.0:
        return _SHARE_MIN
    return float(np.clip(near.chances[name] / abs(near.errors[name]), _SHARE_MIN, _SHARE_MAX))


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
        coarse: tuple[Observation, Observation],
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
        drift, further = (self.errors(each)[0] for each in coarse)
        first, second = (1.0 / (COARSENING ** (k * _ORDER_LOW) - 1.0) for k in (1, 2))
        force = extrapolated(self._force, (1.0 + drift["force"]) * self._force, order=order)
        depth = extrapolated(self._depth, coarse[0].depth_m, order=order)
        self._force, self._depth = force.force_n, depth.force_n
        self.bars = {
            name: max(first * abs(error), second * abs(further[name]))
            for name, error in drift.items()
        }
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
        return replace(found.row, errors=errors, zncc_contact=zncc)


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
