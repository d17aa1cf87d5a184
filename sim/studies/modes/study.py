"""The study of contact modes: a punch pressed, slid and turned, and a ball in three sensors.

Figures have sections, meshes, pressure and tangential traction. Scale bars are in SI units. Colour
maps are cividis and PuOr, which survive colour-blind eyes.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.tri import Triangulation

from sim.fields.stress import recovered_stress
from sim.scene.indenter import Cylinder, Sphere, describe
from sim.scene.scene import Preset
from sim.scene.scene_parsing import parse_indenter
from sim.sensor.sensor import load_sensor
from sim.solve.model import Model
from sim.studies.modes.contact_signature import SurfaceMaps, surface_maps, traction_arrows
from sim.studies.modes.runs import (
    BALL,
    BALL_PRESET,
    FRICTION,
    ModeRun,
    press_in,
    slide_mode,
    twist_mode,
)
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.plot_style import INK, PAGE_IN
from tacauchy_rig.core.study import Case, Result, Study, failures_table, founds
from tacauchy_rig.core.tables import Table

_MOVED_ON = "gelsight-mini"
_SENSORS = ("gelsight-mini", "digit", "9dtact")
_BALL = "ball on "


@dataclass
class Modes(Study):
    """A cylinder's or a sphere's modes on one sensor, then a ball's press on three.

    Raises:
        ConfigError: The indenter is not round.
    """

    indenter: InitVar[str]
    preset: Preset

    name, title, kind = "contact_modes", "Contact modes", "run"
    is_together, is_resumable, is_framed = True, False, True
    template = "page.md.jinja"

    def __post_init__(self, indenter: str) -> None:
        body = parse_indenter(indenter)
        if not isinstance(body, Cylinder | Sphere):
            raise ConfigError(
                f"--indenter {describe(body)}: only round bodies can be slid and turned here",
                remedy="give a cylinder with a fillet, or a sphere",
            )
        self._body = body

    def cases(self) -> Sequence[Case]:
        """Return the modes, which go on from the press, and the ball's presses."""

        @cache
        def pressed() -> ModeRun:
            return press_in(load_sensor(_MOVED_ON), self._body, preset=self.preset)

        modes: dict[str, Callable[[], ModeRun]] = {
            "press": pressed,
            "slide": lambda: slide_mode(pressed()),
            "twist": lambda: twist_mode(pressed()),
            **{
                f"{_BALL}{name}": partial(press_in, load_sensor(name), BALL, preset=BALL_PRESET)
                for name in _SENSORS
            },
        }
        return [Case(name=name, measure=measure) for name, measure in modes.items()]

    def line(self, result: Result) -> str:
        """Return the forces of a run."""
        seen = result.found.signature
        return f"F_n {seen.normal_size_n:.4f} N, tangential {seen.tangential_sum_n:.4f} N in sum"

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return the criteria of every run."""
        return [*map(_criteria, founds(results)), *failures_table(results, kind=self.kind)]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the runs with their signatures and criteria."""
        return {"preset": self.preset, "modes": [run.as_json() for run in founds(results)]}

    def figures(self, results: Sequence[Result]) -> Mapping[str, Figure]:
        """Draw the modes, and the ball in its sensors."""
        moved, pressed = _parted(results)
        found = {"contact_modes": modes_figure(moved)} if moved else {}
        return found | ({"three_sensors": sensors_figure(pressed)} if pressed else {})

    def page_facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the runs with their criteria and signatures."""
        moved, pressed = _parted(results)
        return {
            "preset": self.preset,
            "friction": FRICTION,
            "missed": [run.title for run in (*moved, *pressed) if not run.passed],
            "ball_preset": BALL_PRESET.value,
            "moved": moved,
            "pressed": pressed,
        }


def _parted(results: Sequence[Result]) -> tuple[list[ModeRun], list[ModeRun]]:
    """Return the modes of the moved body, and the ball's presses."""
    is_ball = [result.name.startswith(_BALL) for result in results if not result.failure]
    runs = list(zip(founds(results), is_ball, strict=True))
    return [run for run, ball in runs if not ball], [run for run, ball in runs if ball]


def _criteria(run: ModeRun) -> Table:
    return Table(
        columns=("criterion", "measured", "limit", "verdict"),
        rows=tuple((row.name, row.measured, row.limit, row.verdict) for row in run.criteria),
        title=run.title,
        criterion="every number is within its limit",
        passed=run.passed,
    )


# Just beside the plane, so that no node lies on it.
_BESIDE_SHARE = 1e-5


def section(
    model: Model, positions: FloatArray, x_m: FloatArray, z_m: FloatArray, *, y_m: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Sample the deformed pad where columns and rows of a plane across y meet; edges are straight.

    Returns:
        Stress, recovered in each layer [Pa], shape [row_count, column_count, 3, 3], and the number
        of the layer, shape [row_count, column_count]; not a number beside the gel.
    """
    pyvista: Any = importlib.import_module("pyvista")
    places = pyvista.RectilinearGrid(x_m, [y_m + _BESIDE_SHARE * model.height_m], z_m)
    stress = np.full((len(z_m) * len(x_m), 9), np.nan)
    layer_at = np.full(len(stress), np.nan)
    layers = model.mesh.layers
    labels = np.zeros(len(model.elements), dtype=np.int32) if layers is None else layers
    for layer in range(int(labels.max()) + 1):
        own = labels == layer
        nodes, corners = np.unique(model.elements[own, :4], return_inverse=True)
        cells = {pyvista.CellType.TETRA: corners.reshape(-1, 4)}
        grid = pyvista.UnstructuredGrid(cells, positions[nodes])
        grid["stress"] = recovered_stress(model, positions, own)[nodes].reshape(-1, 9)
        found = places.sample(grid)
        inside = found["vtkValidPointMask"] > 0
        stress[inside], layer_at[inside] = found["stress"][inside], layer
    shape = (len(z_m), len(x_m))
    return stress.reshape(*shape, 3, 3), layer_at.reshape(shape)


_STEEL = "#C9CED6"
_MM, _KPA = 1e3, 1e-3
_SECTION_MIN_MM, _SECTION_POINTS = 3.0, (400, 300)
_ARROW_MIN_SHARE = 5e-3
_TITLES = {"press": "normal press", "slide": "lateral translation", "twist": "axial rotation"}
# The shear that a mode is about, seen in the plane y = 0.
_SHEARS = {"press": "xz", "slide": "xz", "twist": "yz"}


def modes_figure(runs: Sequence[ModeRun]) -> Figure:
    """Draw modes, one a row: stress in a section, pressure, tangential traction, shear."""

    def draw(run: ModeRun, row: Sequence[Axes], maps: SurfaceMaps) -> str:
        _draw_pressure(row[1], run, maps)
        _draw_traction(row[2], run, maps)
        _draw_section(row[3], run, _SHEARS[run.name])
        return f"{_TITLES[run.name]}, {run.travel}"

    return _drawn(runs, draw, height_in=1.5, widths=(1.35, 1, 1, 1.35))


def sensors_figure(runs: Sequence[ModeRun]) -> Figure:
    """Draw a press on sensors, one a row: section, mesh, pressure, tangential traction."""

    def draw(run: ModeRun, row: Sequence[Axes], maps: SurfaceMaps) -> str:
        _draw_mesh(row[1], maps)
        _draw_pressure(row[2], run, maps)
        _draw_traction(row[3], run, maps)
        return f"{run.sensor.title}, {run.travel}, {len(run.path.model.elements)} tetrahedra"

    return _drawn(runs, draw, height_in=1.75, widths=(1.35, 0.95, 1, 1))


def _drawn(
    runs: Sequence[ModeRun],
    draw: Callable[[ModeRun, Sequence[Axes], SurfaceMaps], str],
    *,
    height_in: float,
    widths: tuple[float, ...],
) -> Figure:
    """Return a figure of one row a run: stress along z in a section, and what ``draw`` fills in.

    It returns the row's title.
    """
    figure = Figure(figsize=(PAGE_IN, height_in * len(runs)), layout="constrained")
    parts = figure.subfigures(len(runs), 1, squeeze=False)[:, 0]
    for part, run in zip(parts, runs, strict=True):
        row = part.subplots(1, len(widths), width_ratios=widths)
        _draw_section(row[0], run, "zz")
        title = draw(run, row, surface_maps(run.path, run.point))
        force = f"$F_z$ = {run.point.force_n[2]:.2f} N"
        part.suptitle(f"{title}, {force}", x=0.01, ha="left")
    return figure


def _reach(run: ModeRun) -> float:
    """Return half the width of the maps [mm], about 1.5 contact radii."""
    contact = run.point.equilibrium.contact
    touched = np.any(contact.forces != 0.0, axis=2)
    arms = (contact.points - run.point.state.tip)[touched][:, :2]
    return float(1.5 * np.linalg.norm(arms, axis=1).max() * _MM)


def _draw_section(axes: Axes, run: ModeRun, entry: str) -> None:
    """Draw an entry of the stress, such as ``xz``, in the plane y = 0, and where layers meet."""
    tip, height = run.point.state.tip * _MM, run.path.model.height_m * _MM
    reach = max(1.2 * _reach(run), _SECTION_MIN_MM)
    x = np.linspace(tip[0] - reach, tip[0] + reach, _SECTION_POINTS[0])
    z = np.linspace(0.0, 1.35 * height, _SECTION_POINTS[1])
    stress, layers = section(run.path.model, run.point.state.positions, x / _MM, z / _MM)
    i, j = ("xyz".index(axis) for axis in entry)
    values = stress[..., i, j] * _KPA
    # A few points at a rim would wash out all the rest.
    limit = float(np.nanquantile(np.abs(values), 0.98))
    look: Any = {"cmap": "PuOr_r", "vmin": -limit, "vmax": limit, "origin": "lower"}
    shown = axes.imshow(values, extent=(x[0], x[-1], z[0], z[-1]), **look)
    axes.contour(x, z, layers, levels=[0.5], colors=INK, linewidths=0.5)
    _draw_indenter(axes, run)
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(0.0, z[-1])
    _label(axes, "z")
    _bar(axes, shown, rf"$\sigma_{{{entry}}}$ (kPa)", extend="both")


def _draw_indenter(axes: Axes, run: ModeRun) -> None:
    """Draw the rigid body's outline in the plane of the section."""
    radius = run.indenter.radius_m
    x = np.linspace(-radius, radius, 401)
    below = run.indenter.lower_surface(x, np.zeros_like(x))
    tip = run.point.state.tip
    top = run.path.model.height_m * 2.0
    x = np.concatenate([x, x[[-1, 0]]]) + tip[0]
    z = np.concatenate([below + tip[2], [top, top]])
    axes.add_patch(
        Polygon(np.column_stack([x, z]) * _MM, facecolor=_STEEL, edgecolor=INK, linewidth=0.6)
    )


def _draw_mesh(axes: Axes, maps: SurfaceMaps) -> None:
    """Draw the elements' faces on the whole contact surface, seen along z."""
    corners = maps.points_m[maps.corner_faces][..., :2] * _MM
    axes.add_collection(PolyCollection(list(corners), facecolors="none", edgecolors=INK, lw=0.2))
    low, high = corners.reshape(-1, 2).min(axis=0), corners.reshape(-1, 2).max(axis=0)
    axes.set_xlim(low[0] - 0.3, high[0] + 0.3)
    axes.set_ylim(low[1] - 0.3, high[1] + 0.3)
    _label(axes, "y")


def _draw_pressure(axes: Axes, run: ModeRun, maps: SurfaceMaps) -> None:
    _draw_map(axes, run, maps, maps.pressure_pa * _KPA, "$-p_n$ (kPa)")
    x, y = np.array(run.signature.centre_m) * _MM + run.point.state.tip[:2] * _MM
    axes.plot([x], [y], marker="+", color="white", markersize=6, markeredgewidth=1.0)


def _draw_traction(axes: Axes, run: ModeRun, maps: SurfaceMaps) -> None:
    size = np.linalg.norm(maps.tangential_pa, axis=1) * _KPA
    _draw_map(axes, run, maps, size, r"$|\mathbf{t}_\tau|$ (kPa)")
    pitch = _reach(run) / _MM / 6.0
    places, arrows = traction_arrows(run.point, pitch_m=pitch)
    sizes = np.linalg.norm(arrows, axis=1)
    shown = sizes > _ARROW_MIN_SHARE * sizes.max()
    # The root of the size, so that the middle is seen beside the rim.
    lengths = arrows[shown] / np.sqrt(sizes[shown] * sizes.max())[:, None]
    heads: Any = {"width": 0.014, "headwidth": 3.2, "headlength": 3.6, "headaxislength": 3.2}
    colours: Any = {"color": "white", "edgecolor": INK, "linewidth": 0.25}
    units: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0 / (1.2 * pitch * _MM)}
    where = *(places[shown].T * _MM), *lengths.T
    axes.quiver(*where, pivot="mid", **units, **colours, **heads)


def _draw_map(axes: Axes, run: ModeRun, maps: SurfaceMaps, values: FloatArray, name: str) -> None:
    grid = _triangulation(maps.points_m, maps.triangles)
    limit = np.quantile(values[values > 0.0], 0.99)
    look: Any = {"cmap": "cividis", "vmin": 0.0, "vmax": float(limit), "rasterized": True}
    shown = axes.tripcolor(grid, values, shading="gouraud", **look)
    reach, tip = _reach(run), run.point.state.tip * _MM
    axes.set_xlim(tip[0] - reach, tip[0] + reach)
    axes.set_ylim(tip[1] - reach, tip[1] + reach)
    _label(axes, "y")
    _bar(axes, shown, name, extend="max")


def _label(axes: Axes, upwards: str) -> None:
    axes.set_aspect("equal")
    axes.set_xlabel("$x$ (mm)")
    axes.set_ylabel(f"${upwards}$ (mm)")


def _triangulation(points_m: FloatArray, triangles: IntArray) -> Triangulation:
    return Triangulation(points_m[:, 0] * _MM, points_m[:, 1] * _MM, triangles)


def _bar(axes: Axes, shown: Any, name: str, *, extend: str) -> None:
    """Put a scale beside the axes, as high as they are."""
    beside = axes.inset_axes((1.04, 0.0, 0.055, 1.0))
    bar = axes.figure.colorbar(shown, cax=beside, extend=extend)
    bar.ax.set_title(name, loc="left", fontsize=7, pad=3)
    bar.outline.set_linewidth(0.5)
