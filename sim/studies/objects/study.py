"""Five objects pressed into sensors, and what their cameras would see: presses, figure, page."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import InitVar, dataclass
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from sim.effects.effect_choice import plan_effects
from sim.effects.press_with_effects import follow, path_for
from sim.fields.saved_press import surface_state
from sim.optics.height.height_map import HeightMaps, height_maps
from sim.optics.render.renderer import nominal_renderer
from sim.scene.indenter import MeshIndenter
from sim.scene.objects import OBJECTS
from sim.scene.scene import Preset, Target
from sim.scene.triangle_surface import TriangleSurface
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor, load_sensor
from sim.solve.equilibrium import SolverOptions
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.plot_style import INK, PAGE_IN
from tacauchy_rig.core.study import Case, Result, Study, failures_table, founds
from tacauchy_rig.core.tables import Table, table_of

DEPTH_M = 0.4e-3
_HIGHEST = "highest pixel above the object [um]"
_GREY = 118
_SAMPLES = 2

# Where faces meet in a hollow edge the gel's balance has a kink, and Newton comes no further than
# 2e-6 of the contact force.
_RESIDUAL_RELATIVE = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectPress:
    """One object in one sensor."""

    name: str
    sensor: str  # its title
    force_n: float
    maps: HeightMaps
    surface: TriangleSurface  # the object's
    image: ImageArray  # by the sensor's nominal optics over an even frame, RGB
    geometry: CameraGeometry
    highest_over_m: float  # largest height of a pixel above the object; not positive
    processor_s: float  # for the press and its image


def press_object(name: str, sensor: Sensor, *, preset: Preset) -> ObjectPress:
    """Press an object 0.4 mm deep and render it."""
    render = nominal_renderer(sensor, level=_GREY, samples=_SAMPLES)
    geometry = sensor.camera
    started = time.process_time()
    body: MeshIndenter = OBJECTS[name]()
    scene = sensor.scene(body, Target(depth_m=DEPTH_M), preset=preset)
    path = path_for(scene, plan_effects(scene))
    path.options = SolverOptions(residual_relative=_RESIDUAL_RELATIVE)
    point = follow(scene, path)
    surface = surface_state(path, point)
    maps = height_maps(surface, geometry, pad=sensor.pad)
    fine = height_maps(surface, geometry.refined(_SAMPLES), pad=sensor.pad)
    underside = body.lower_surface(*geometry.pad_grid())
    return ObjectPress(
        name=name,
        sensor=sensor.title,
        force_n=float(point.force_n[2]),
        maps=maps,
        surface=body.surface,
        image=render(fine),
        geometry=geometry,
        highest_over_m=float((maps.loaded - surface.indenter_position[2] - underside).max()),
        processor_s=time.process_time() - started,
    )


_MM = 1e3
_ROW_IN = 0.98
_SLANT_RAD = math.radians(35.0)
_LIGHT = np.array([0.35, -0.15, -0.92])
_DARKEST = 0.35
_BAR_MM = 2.0


def objects_figure(runs: Sequence[Sequence[ObjectPress]]) -> Figure:
    """Draw the objects, one a column, and below them dent and image on each sensor.

    Of each sensor there are the objects in one order.
    """
    rows, columns = 1 + 2 * len(runs), len(runs[0])
    half = np.min([_half_view_mm(sensor[0].geometry) for sensor in runs], axis=0)
    layout = ConstrainedLayoutEngine(w_pad=0.02, h_pad=0.02, hspace=0.01, wspace=0.01)
    figure = Figure(figsize=(PAGE_IN, _ROW_IN * rows), layout=layout)
    axes = figure.subplots(rows, columns, squeeze=False)
    for column, run in enumerate(runs[0]):
        axes[0, column].set_title(run.name)
        _draw_body(axes[0, column], run.surface)
        _frame(axes[0, column], half)
    axes[0, 0].set_ylabel("object,\nfrom below")
    for k, sensor in enumerate(runs):
        _draw_sensor(axes[1 + 2 * k : 3 + 2 * k], sensor, half)
    left, low = -0.94 * half[0], 0.86 * half[1]
    axes[0, 0].plot([left, left + _BAR_MM], [low, low], color=INK, linewidth=1.2)
    axes[0, 0].text(left, low - 0.35, f"{_BAR_MM:g} mm", fontsize=6.5, va="bottom")
    return figure


def _draw_sensor(axes: Any, sensor: Sequence[ObjectPress], half_mm: FloatArray) -> None:
    """Draw a sensor's dents and images, one a column of two rows of axes."""
    deepest = max(float((run.maps.rest - run.maps.loaded).max()) for run in sensor)
    for (dented, seen), run in zip(axes.T, sensor, strict=True):
        extent = _extent_mm(run.geometry)
        dent = (run.maps.rest - run.maps.loaded) * _MM
        drawn = dented.imshow(dent, cmap="cividis", vmin=0.0, vmax=deepest * _MM, extent=extent)
        force = f"{run.force_n:.2f} N"
        dented.text(0.03, 0.95, force, color="white", va="top", transform=dented.transAxes)
        seen.imshow(run.image, extent=extent)
        _frame(dented, half_mm)
        _frame(seen, half_mm)
    axes[0, 0].set_ylabel(f"{sensor[0].sensor}\ndent")
    axes[1, 0].set_ylabel(f"{sensor[0].sensor}\nimage")
    beside = axes[0, -1].inset_axes((1.04, 0.0, 0.05, 1.0))
    bar = axes[0, -1].figure.colorbar(drawn, cax=beside, label="dent (mm)")
    bar.outline.set_linewidth(0.5)


def _draw_body(axes: Axes, surface: TriangleSurface) -> None:
    """Draw a body's faces from below at a slant, the farthest first, lit from the camera's side."""
    towards = np.array([0.0, -math.sin(_SLANT_RAD), -math.cos(_SLANT_RAD)])
    down = np.array([0.0, math.cos(_SLANT_RAD), -math.sin(_SLANT_RAD)])
    corners = surface.vertices[surface.faces]
    seen = np.flatnonzero(surface.face_normals @ towards > 0.0)
    seen = seen[np.argsort(corners[seen].mean(axis=1) @ towards)]
    lit = np.clip(surface.face_normals[seen] @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
    grey = _DARKEST + (1.0 - _DARKEST) * lit
    flat = np.stack([corners[seen][..., 0], corners[seen] @ down], axis=-1) * _MM
    middle = 0.5 * (flat.reshape(-1, 2).min(axis=0) + flat.reshape(-1, 2).max(axis=0))
    colours = np.repeat(grey[:, None], 3, axis=1)
    axes.add_collection(
        PolyCollection(list(flat - middle), facecolors=colours, edgecolors=colours, linewidths=0.4)
    )


def _frame(axes: Axes, half_mm: FloatArray) -> None:
    """Show the same piece of the pad everywhere, rows growing downwards, without ticks."""
    axes.set_xlim(-half_mm[0], half_mm[0])
    axes.set_ylim(half_mm[1], -half_mm[1])
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])


def _extent_mm(geometry: CameraGeometry) -> tuple[float, float, float, float]:
    """Return what an image shows of the pad: left, right, bottom, top [mm]."""
    corners = [[-0.5, -0.5], [geometry.width - 0.5, geometry.height - 0.5]]
    (left, top), (right, bottom) = (geometry.to_pad(np.array(corners)) * _MM).tolist()
    return left, right, bottom, top


def _half_view_mm(geometry: CameraGeometry) -> FloatArray:
    left, right, bottom, top = _extent_mm(geometry)
    return np.array([min(-left, right), min(-top, bottom)])


@dataclass
class Objects(Study):
    """Five objects, from sharp edges to smooth curves, in each sensor, named or by its file."""

    sensors: InitVar[str]
    preset: Preset

    name, title, kind = "objects", "Five objects", "press"
    is_resumable, is_framed = False, True
    template = "page.md.jinja"

    def __post_init__(self, sensors: str) -> None:
        names = [name.strip() for name in sensors.split(",") if name.strip()]
        self._sensors = {name: load_sensor(name) for name in names}

    def cases(self) -> Sequence[Case]:
        """Return every object in every sensor."""
        return [
            Case(
                name=f"{label} in {name}",
                measure=partial(press_object, label, sensor, preset=self.preset),
                process=name,
            )
            for name, sensor in self._sensors.items()
            for label in OBJECTS
        ]

    def line(self, result: Result) -> str:
        """Return the force."""
        return f"{result.found.force_n:.3f} N"

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return the presses; no pixel of a height map may lie above its object."""
        pressed = table_of(
            founds(results),
            {
                "sensor": lambda press: press.sensor,
                "object": lambda press: press.name,
                "F_z [N]": lambda press: press.force_n,
                # Below a picometre it is rounding.
                _HIGHEST: lambda press: max(0.0, round(1e6 * press.highest_over_m, 6)),
                "time [s]": lambda press: round(press.processor_s),
            },
            title=f"{DEPTH_M * 1e3:g} mm deep, preset {self.preset.value}, nominal optics",
        )
        return [pressed] * bool(pressed.rows) + failures_table(results, kind=self.kind)

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the presses."""
        rows = [
            {
                "sensor": press.sensor,
                "object": press.name,
                "force_n": press.force_n,
                "highest_over_object_m": press.highest_over_m,
                "processor_s": press.processor_s,
            }
            for press in founds(results)
        ]
        return {"preset": self.preset, "depth_m": DEPTH_M, "presses": rows}

    def figures(self, results: Sequence[Result]) -> Mapping[str, Figure]:
        """Draw the objects, one a column, in the sensors that have them all."""
        groups = [list(rows) for _, rows in groupby(founds(results), key=lambda run: run.sensor)]
        most = max(map(len, groups))
        return {"five_objects": objects_figure([rows for rows in groups if len(rows) == most])}

    def page_facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the objects and their presses."""
        bodies, presses = OBJECTS, founds(results)
        return {"depth_m": DEPTH_M, "preset": self.preset, "bodies": bodies, "presses": presses}
