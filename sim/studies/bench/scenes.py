"""The benchmark's scenes: what is pressed, in which manner, and what forces are compared with."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from math import hypot, nan
from pathlib import Path
from statistics import geometric_mean
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from pydantic import TypeAdapter

from sim.mesh_bias_correction import Corrected
from sim.studies import from_file
from sim.tolerance import parse_tolerance
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.markdown_page import table_prose
from tacauchy_rig.core.plot_style import BLUE, COLUMN_IN, GREEN, ORANGE, PURPLE, SKY
from tacauchy_rig.core.store.json_codec import from_json, loads
from tacauchy_rig.core.tables import Cell, Table, table_of

FRAME_COUNT = 20
_DRAWN = 12

Scenes = Mapping[str, dict[str, Any]]
"""By name: options of ``tacauchy-rig press``, or an ``object`` instead of an indenter."""


def all_scenes() -> Scenes:
    """Return every scene, in the order of the page."""
    return {line.pop("name"): line for line in from_file("bench/scenes.toml")["scene"]}


def drawn_scenes(seed: int) -> Scenes:
    """Return a dozen scenes that nobody chose, always the same for a seed.

    Half of them are balls, half have friction, half of those move along the surface.
    """
    random = np.random.default_rng(seed)
    return dict(_drawn(random, number) for number in range(1, _DRAWN + 1))


def _drawn(random: np.random.Generator, number: int) -> tuple[str, dict[str, Any]]:
    size, kind = random.uniform(3.0, 10.0), "ball"
    body = f"sphere:diameter={size:.1f}mm"
    if random.random() < 0.5:
        kind, fillet = "punch", random.uniform(0.1, 0.4)
        body = f"cylinder:diameter={size / 1.5:.1f}mm,fillet={fillet:.2f}mm"
    stated = {
        "sensor": str(random.choice(["gelsight-mini", "digit", "9dtact"])),
        "indenter": body,
        "depth": f"{random.uniform(0.15, 0.8):.2f}mm",
    }
    words = [f"{kind} {number}"]
    if stated["sensor"] != "9dtact":
        stated["poisson"] = f"{random.uniform(0.35, 0.49):.3f}"
    if random.random() < 0.5:
        stated |= {"contact": f"friction:{random.uniform(0.2, 1.0):.2f}", "effect": "friction=on"}
        words.append("friction")
        if random.random() < 0.5:
            stated["shift"] = f"{random.uniform(0.02, 0.15):.2f}mm"
            words.append("sliding")
    if random.random() < 0.3:
        stated["force"] = f"{random.uniform(0.2, 2.0):.2f}N"
        del stated["depth"]
        words.append("pushed")
    return ", ".join(words), stated


@dataclass(frozen=True, slots=True, kw_only=True)
class Manner:
    """How every scene is pressed."""

    tolerance: str = "5%"  # of F_z; the cheapest setting that keeps it is taken
    device: str = "cpu"
    environments: int | None = None  # of a batch; None presses alone
    images: bool = False  # with the image, markers and stress of every frame, in a batch

    @property
    def text(self) -> str:
        """All of it in words."""
        if self.environments is None:
            return f"{self.device}, alone, tolerance {self.tolerance}"
        many = f"{self.environments} environment{'s' * (self.environments > 1)}"
        return f"{self.device}, {many}{', with images' * self.images}"

    @property
    def wanted(self) -> list[float] | None:
        """Frames a second that are wanted, mean and least; None where none are."""
        alone = {"cpu": self.device == "cpu", "environments": self.environments or 0}
        own = alone | {"tolerance": self.tolerance, "images": self.images}
        rows = from_file("bench/scenes.toml")["wanted"]
        return next((r["frames_per_s"] for r in rows if own.items() <= r.items()), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenePress:
    """What a scene's frames took, and the forces of the last of them."""

    preset: str
    edges: float  # how many times as long as the preset's
    promised: bool  # the setting states to keep the tolerance
    tet_count: int
    unknown_count: int
    setup_s: float  # mesh, upload and symbolic factorisation
    wall_s: float  # all frames of all environments
    cpu_s: float  # processor time of the same
    iterations: int  # Newton's and the like, all frames
    force_n: tuple[float, float, float]  # on the indenter in the last frame
    moment_nm: tuple[float, float, float] | None  # about its tip; None where it is not computed
    depth_m: float
    stiffness_n_m: float  # dF_z / d(depth) in the last frame that goes down
    balance: float  # |indenter force + base reaction| over the former
    # In a batch, what the launch of the stress takes.
    parts_s: dict[str, float] = field(default_factory=dict)
    corrected: Corrected | None = None  # the last frame without the mesh's bias, where it is known


read_press: Callable[[Any], ScenePress] = TypeAdapter(ScenePress).validate_python


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """What a scene is compared with, and what made it if it was kept."""

    stated: dict[str, Any]  # another scene of the same name has no reference
    press: ScenePress
    command: str = ""
    commit: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneRow:
    """A scene that was pressed, or why it was not."""

    scene: str
    manner: Manner
    press: ScenePress | None  # None where ``failure`` says why
    failure: str = ""
    reference: Reference | None = None

    @property
    def setting(self) -> str:
        """Preset and length of edges; * where it does not state the tolerance asked for."""
        if self.press is None:
            return "failed"
        edges = "" if self.press.edges == 1.0 else f" {self.press.edges:.2f}"
        return f"{self.press.preset}{edges}{'' if self.press.promised else '*'}"

    @property
    def frames_per_s(self) -> float:
        """Frames of all environments [1/s].

        Over the thread's time on a CPU, whatever else the machine does; else over that of the wall.
        """
        if self.press is None:
            return nan
        spent_s = self.press.cpu_s if self.manner.device == "cpu" else self.press.wall_s
        return FRAME_COUNT * (self.manner.environments or 1) / spent_s

    @property
    def text(self) -> str:
        """The row in a few words."""
        if self.press is None:
            return self.failure
        force, balance = self.press.force_n[2], self.press.balance
        return f"{self.frames_per_s:.1f} frames/s, F_z {force:.4f} N, balance {balance:.0e}"

    def error(self, *, raw: bool = False) -> float | None:
        """Return how far F_z is off, or the depth where the load is given.

        The result is the corrected one where there is one, unless the mesh's own is asked for.
        """
        press, known = self.press, self.reference
        if press is None or known is None:
            return None
        force, depth = press.force_n[2], press.depth_m
        if press.corrected is not None and not raw:
            force, depth = press.corrected.force_n, press.corrected.depth_m
        if "force" in known.stated:
            return depth / known.press.depth_m - 1.0
        return force / known.press.force_n[2] - 1.0

    @property
    def stated_error(self) -> float | None:
        """The error that the corrected result is said to have."""
        corrected = None if self.press is None else self.press.corrected
        return None if corrected is None else corrected.error_relative

    @property
    def sideways_error(self) -> float | None:
        """How far the motion's resistance is off: M_z of a twist, F_xy of a shift."""
        if self.press is None or self.reference is None:
            return None
        found, known, stated = self.press, self.reference.press, self.reference.stated
        if found.moment_nm is None or known.moment_nm is None:
            return None
        if "twist" in stated:
            return found.moment_nm[2] / known.moment_nm[2] - 1.0
        if "shift" in stated:
            return hypot(*found.force_n[:2]) / hypot(*known.force_n[:2]) - 1.0
        return None

    def as_json(self) -> dict[str, Any]:
        """Return plain values, the manner's among them."""
        own = {"scene": self.scene, "press": self.press, "failure": self.failure}
        return {**asdict(self.manner), **own}


def read_references(file: Path, scenes: Scenes) -> dict[str, Reference]:
    """Return what a file knows of these very scenes; nothing where there is no file.

    It holds references by name, or is the JSON of a benchmark that has measured some.
    """
    if not file.exists():
        return {}
    try:
        stored = loads(file.read_bytes(), source=str(file))
        stored = stored.get("references", stored)
        found = from_json(dict[str, Reference], stored, source=str(file))
    except (OSError, RecordError) as error:
        raise ConfigError(
            f"{file} holds no references: {error}", remedy="make one with --reference and --json"
        ) from error
    return {name: each for name, each in found.items() if scenes.get(name) == each.stated}


# From here on frames a second are shown as whole numbers.
_WHOLE = 100.0
_prose = partial(table_prose, "sim.studies.bench", "scenes.md.jinja")


def _of_press(name: str) -> Callable[[SceneRow], Cell]:
    """Return what shows a field of a row's press, if it has one."""
    return lambda row: None if row.press is None else getattr(row.press, name)


def scene_tables(rows: Sequence[SceneRow]) -> list[Table]:
    """Return the tables of scenes that were pressed in one manner."""
    tables = [_speed(rows), _forces(rows), _work(rows)]
    return [*tables, _launches(rows)] if any(r.press and r.press.parts_s for r in rows) else tables


def _speed(rows: Sequence[SceneRow]) -> Table:
    manner = rows[0].manner
    found = [row.frames_per_s for row in rows if row.press]
    wanted, counts = manner.wanted, {"measured": len(found), "count": len(rows)}
    mean, least = geometric_mean(found) if found else math.nan, min(found, default=0.0)
    is_met = wanted is None or (mean >= wanted[0] and least >= wanted[1])
    return table_of(
        rows,
        {
            "scene": lambda row: row.scene,
            "preset": lambda row: row.setting,
            "frames/s": lambda row: None if row.press is None else _counted(row.frames_per_s),
            "processor [s]": _of_press("cpu_s"),
            "wall [s]": _of_press("wall_s"),
        },
        passed=is_met and (wanted is None or len(found) == len(rows)),
        **_prose(
            "speed",
            way=manner.text,
            wanted=wanted and tuple(wanted),
            mean=f"{mean:.1f}",
            least=f"{least:.1f}",
            frames=FRAME_COUNT,
            is_cpu=manner.device == "cpu",
            **counts,
        ),
    )


def _forces(rows: Sequence[SceneRow]) -> Table:
    manner, unknown = rows[0].manner, [row.scene for row in rows if row.reference is None]
    text = manner.tolerance if len(unknown) < len(rows) else ""
    allowed = parse_tolerance(text, field="--tolerance") if text else None

    def is_within(row: SceneRow) -> bool:
        off = row.error()
        if off is None or row.reference is None or allowed is None:
            return allowed is None
        return abs(off) <= allowed.of(row.reference.press.force_n[2])

    return table_of(
        rows,
        {
            "scene": lambda row: row.scene,
            "F_z [N]": lambda row: None if row.press is None else row.press.force_n[2],
            "by the reference [N]": lambda row: (
                None if row.reference is None else row.reference.press.force_n[2]
            ),
            "its preset": lambda row: None if row.reference is None else row.reference.press.preset,
            "off by [%]": lambda row: _percent(row.error()),
            "raw off by [%]": lambda row: _percent(row.error(raw=True)),
            "stated [%]": lambda row: _percent(row.stated_error),
            "sideways off by [%]": lambda row: _percent(row.sideways_error),
            "balance": lambda row: None if row.press is None else f"{row.press.balance:.0e}",
        },
        passed=all(map(is_within, rows)),
        **_prose("forces", way=manner.text, allowed=text, unknown=unknown),
    )


def _launches(rows: Sequence[SceneRow]) -> Table:
    found = [(row.scene, row.press.parts_s) for row in rows if row.press]
    names = dict.fromkeys(name for _, parts in found for name in parts)

    def time_us(row: tuple[str, dict[str, float]], name: str) -> Cell:
        return round(1e6 * row[1][name], 1) if name in row[1] else None

    times = {f"{name} [us]": partial(time_us, name=name) for name in names}
    prose = _prose("launches", way=rows[0].manner.text)
    return table_of(found, {"scene": lambda row: row[0], **times}, **prose)


def _work(rows: Sequence[SceneRow]) -> Table:
    return table_of(
        rows,
        {
            "scene": lambda row: row.scene,
            "tetrahedra": _of_press("tet_count"),
            "unknowns": _of_press("unknown_count"),
            "iterations": _of_press("iterations"),
            "set-up [s]": _of_press("setup_s"),
        },
        **_prose("work", way=rows[0].manner.text),
    )


def _counted(speed: float) -> Cell:
    return round(speed) if speed >= _WHOLE else f"{speed:.3g}"


def _percent(share: float | None) -> Cell:
    return None if share is None else f"{1e2 * share:+.2f}"


_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY)
# Of a bar, of a scene at least, and of the axis with its labels and the legend [inch].
_BAR_IN, _SCENE_IN, _LABELS_IN = 0.1, 0.16, 1.0


def scenes_figure(groups: Sequence[Sequence[SceneRow]]) -> Figure:
    """Draw frames a second on a logarithmic axis, a colour for each manner."""
    names = [row.scene for row in groups[0]]
    height = 0.8 / len(groups)
    tall = _LABELS_IN + len(names) * max(_SCENE_IN, _BAR_IN * len(groups))
    figure = Figure(figsize=(1.4 * COLUMN_IN, tall), layout="constrained")
    axes = figure.add_subplot()
    for k, rows in enumerate(groups):
        axes.barh(
            [n + (k - 0.5 * (len(groups) - 1)) * height for n in range(len(rows))],
            [row.frames_per_s if row.press else 0.0 for row in rows],
            height=0.9 * height,
            color=_COLOURS[k % len(_COLOURS)],
            hatch="////" * (k // len(_COLOURS)),
            label=rows[0].manner.text,
        )
    axes.set_xscale("log")
    least = min(row.frames_per_s for rows in groups for row in rows if row.press)
    # An axis that began at the least would make a slow scene look like none.
    axes.set_xlim(left=10.0 ** math.floor(math.log10(least)))
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.grid(axis="x")
    axes.set_xlabel("Frames a second")
    figure.legend(loc="outside upper right", ncols=2)
    return figure
