"""Errors of many configurations against one reference whose own error is shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from sim.mesh.elements import ElementOrder
from sim.optics.height.height_map import HeightMaps
from sim.scene.scene import Preset, Scene
from sim.sensor.camera_geometry import CameraGeometry
from sim.studies.accuracy.press import (
    COARSENING,
    Configuration,
    Observation,
    Row,
    coarser,
    height_error,
    observe,
)
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
ORDER_SHARP, ORDER_SMOOTH = 1.0, 2.0
_DOUBT_SHARE = 0.5


def error_order(scene: Scene) -> float:
    """Return the order at which F_z is taken to converge; stress is singular at a sharp rim."""
    return ORDER_SHARP if scene.has_sharp_rim else ORDER_SMOOTH


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceLimit:
    """The limit of F_z at one depth.

    Attributes:
        force_n: The limit [N].
        doubt: Relative error that it may have: half of what was extrapolated.
    """

    force_n: float
    doubt: float

    def error(self, force_n: float) -> float:
        """Return the relative error of a force [N], with its sign."""
        return force_n / self.force_n - 1.0


def extrapolated(force_n: float, coarser_n: float, *, order: float) -> ForceLimit:
    """Return the limit beyond a force and one on edges 1.5 times as long (Richardson 1911)."""
    share = 1.0 / (COARSENING**order - 1.0)
    limit = force_n + share * (force_n - coarser_n)
    return ForceLimit(force_n=limit, doubt=_DOUBT_SHARE * abs(force_n / limit - 1.0))


class Judge:
    """Compares presses with a reference.

    F_z and depth are compared with the limit that the reference and the same on edges 1.5 times as
    long tend to (Richardson, at order 2, or 1 under a sharp rim), half of what was extrapolated
    being its bar. Everything else is compared with the reference itself, whose bar is what order 1
    would leave, which is too much where the contact is smooth: the larger of what that reference
    and the same on edges 2.25 times as long tell, since two meshes may agree by chance.

    Attributes:
        bars: By quantity: how far what is compared with may be from the truth.
        reference: The reference's own row.

    Args:
        scene: A press to a force.
        reference: What is most exact.
        render: Turns height maps into the tactile image.
        similarity: SSIM of two images, and their correlation inside the contact.

    Raises:
        ConvergenceError: The reference cannot be pressed.
    """

    def __init__(
        self,
        scene: Scene,
        geometry: CameraGeometry,
        reference: Configuration,
        *,
        render: Render,
        similarity: Similarity,
    ) -> None:
        self._scene, self._geometry = scene, geometry
        self._render, self._similarity = render, similarity
        self._warm_up()
        exact, coarse, coarsest = (
            observe(scene, each, geometry)
            for each in (reference, coarser(reference), coarser(coarser(reference)))
        )
        self._exact, self._image = exact, render(exact.maps)
        self._force, self._depth = exact.force_n, exact.depth_m
        drift, further = self._errors(coarse)[0], self._errors(coarsest)[0]
        first, second = (1.0 / (COARSENING ** (k * _ORDER_LOW) - 1.0) for k in (1, 2))
        order = error_order(scene)
        force = extrapolated(self._force, (1.0 + drift["force"]) * self._force, order=order)
        depth = extrapolated(self._depth, coarse.depth_m, order=order)
        self._force, self._depth = force.force_n, depth.force_n
        self.bars = {
            name: max(first * abs(error), second * abs(further[name]))
            for name, error in drift.items()
        }
        self.bars |= {"force": force.doubt, "depth": depth.doubt}
        self.reference = self._row(exact)

    def row(self, configuration: Configuration, *, shifted: bool = False) -> Row:
        """Press with a configuration, and return its errors and cost.

        Args:
            shifted: Press on edges longer and shorter by as much as a seed may make them too, for
                what a mesh happens to cut.

        Raises:
            RigError: The scene cannot be meshed or pressed so.
        """
        if configuration == self.reference.configuration:
            return self.reference
        row = self._row(observe(self._scene, configuration, self._geometry))
        if shifted:
            with suppress(RigError):
                others = [
                    self._errors(observe(self._scene, other, self._geometry))[0]
                    for other in map(configuration.refined, (1.0 - EDGE_SHIFT, 1.0 + EDGE_SHIFT))
                ]
                return replace(row, chances=chance_of(row.errors, others))
        return row

    def _row(self, found: Observation) -> Row:
        errors, zncc = self._errors(found)
        return replace(found.row, errors=errors, zncc_contact=zncc)

    def _errors(self, found: Observation) -> tuple[dict[str, float], float]:
        """Return the errors by quantity, and the image's correlation inside the contact."""
        exact = self._exact
        ssim, zncc = self._similarity(self._image, self._render(found.maps), exact.maps)
        force = found.force_n if found is exact else found.force_at(exact.depth_m)
        return {
            "force": force / self._force - 1.0,
            "depth": found.depth_m / self._depth - 1.0,
            "pressure": found.pressure_max_pa / exact.pressure_max_pa - 1.0,
            "radius": found.contact_radius_m / exact.contact_radius_m - 1.0,
            "height": height_error(found.maps, exact.maps),
            "image": 1.0 - ssim,
        }, zncc

    def _warm_up(self) -> None:
        """Compile every kernel that will be timed, on a mesh that costs next to nothing."""
        small = Configuration(name="warm-up", preset=Preset.FAST, refinement=0.25)
        for element in ElementOrder:
            for finite_strain in (True, False):
                kind = replace(small, element=element, finite_strain=finite_strain)
                with suppress(RigError):
                    observe(self._scene, kind, self._geometry)


def finished(rows: Sequence[Row]) -> list[Row]:
    """Return rows with the chances of all, and which of them are on the front of F_z."""
    known = [row for row in rows if row.chances]
    rows = [replace(row, chances=chances(row.configuration, row.errors, known)) for row in rows]
    front = front_of([(row.time_s, abs(row.errors["force"])) for row in rows])
    return [replace(row, on_front=on) for row, on in zip(rows, front, strict=True)]


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
