"""``tacauchy-rig modes``: the contact modes of the paper's figures, drawn and held to numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from sim.scene.scene import Preset
from tacauchy_rig.app.cli.options import FigureFolder, FigurePage, JsonFile
from tacauchy_rig.app.cli.output import say, show_table, writable_folder, write_json, write_text
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.tables import table_of

if TYPE_CHECKING:
    from sim.scene.indenter import Cylinder, Sphere
    from sim.studies.modes.runs import ModeRun


_PUNCH = "cylinder:diameter=5mm,fillet=0.5mm"
_MOVED_ON = "gelsight-mini"
_SENSORS = ("gelsight-mini", "digit", "9dtact")


def modes(
    out: FigureFolder,
    indenter: Annotated[
        str,
        typer.Option(
            "--indenter",
            help="cylinder:diameter=,fillet= or sphere:diameter=",
            show_default="a punch of 5 mm with a fillet of 0.5 mm",
        ),
    ] = _PUNCH,
    preset: Annotated[Preset, typer.Option("--preset")] = Preset.FAST,
    page: FigurePage = None,
    json_file: JsonFile = None,
) -> None:
    """Press, slide and twist on GelSight Mini, press a ball into three sensors; draw both.

    Example: tacauchy-rig study modes --out modes
    """
    from sim.studies.modes.figures import draw_modes, draw_sensors
    from sim.studies.modes.runs import FRICTION

    punch = _round(indenter)
    writable_folder(out)
    images = None if page is None else writable_folder(page.parent / "images")
    say(f"friction {FRICTION:g}, preset {preset.value}")
    punched = list(_shown(_moved_runs(punch, preset)))
    figures = draw_modes(punched, out, page_folder=images)
    pressed = list(_shown(_ball_runs()))
    figures += draw_sensors(pressed, out, page_folder=images)
    for path in figures:
        say(f"figure {path}")
    runs = punched + pressed
    if page is not None:
        command = f"tacauchy-rig modes --out {out} --page {page}"
        if indenter != _PUNCH:
            command += f" --indenter {indenter}"
        if preset is not Preset.FAST:
            command += f" --preset {preset.value}"
        write_text(page, modes_page(punched, pressed, command=command, preset=preset))
        say(f"page {page}")
    write_json(json_file, {"preset": preset, "modes": [run.as_json() for run in runs]})
    raise typer.Exit(0 if all(run.passed for run in runs) else 1)


def _round(text: str) -> Cylinder | Sphere:
    from sim.scene.indenter import Cylinder, Sphere
    from sim.scene.terms import parse_indenter

    indenter = parse_indenter(text)
    if not isinstance(indenter, Cylinder | Sphere):
        raise ConfigError(
            f"--indenter {text}: only round bodies can be slid and turned here",
            remedy="give a cylinder with a fillet, or a sphere",
        )
    return indenter


def _moved_runs(indenter: Cylinder | Sphere, preset: Preset) -> Iterator[ModeRun]:
    from sim.sensor.sensor import load_sensor
    from sim.studies.modes.runs import press_in, slide_mode, twist_mode

    pressed = press_in(load_sensor(_MOVED_ON), indenter, preset=preset)
    yield pressed
    yield slide_mode(pressed)
    yield twist_mode(pressed)


def _ball_runs() -> Iterator[ModeRun]:
    from sim.sensor.sensor import load_sensor
    from sim.studies.modes.runs import BALL, BALL_PRESET, press_in

    for name in _SENSORS:
        yield press_in(load_sensor(name), BALL, preset=BALL_PRESET)


def _shown(runs: Iterator[ModeRun]) -> Iterator[ModeRun]:
    """Say what each run gave as soon as it is there."""
    for run in runs:
        signature = run.signature
        say()
        show_table(
            table_of(
                run.criteria,
                {
                    "criterion": lambda row: row.name,
                    "measured": lambda row: row.measured,
                    "limit": lambda row: row.limit,
                    "verdict": lambda row: row.verdict,
                },
                title=f"{run.title}: F_n {signature.normal_size_n:.4f} N, tangential "
                f"{signature.tangential_sum_n:.4f} N in sum [{run.processor_s:.0f} s]",
            )
        )
        yield run


def modes_page(
    moved: Sequence[ModeRun], pressed: Sequence[ModeRun], *, command: str, preset: Preset
) -> str:
    """Return what was found as a page of Markdown.

    Args:
        moved: A punch's modes on one sensor.
        pressed: One press on several sensors.
        command: What makes the page.
    """
    from sim.scene.indenter import describe
    from sim.studies.modes.runs import BALL_PRESET, FRICTION
    from tacauchy_rig.core.page import page as written

    return written(
        "tacauchy_rig.app.cli.studies",
        "modes.md.jinja",
        {
            "command": command,
            "preset": preset,
            "friction": FRICTION,
            "missed": [run.title for run in (*moved, *pressed) if not run.passed],
            "punch": describe(moved[0].indenter),
            "sensor": moved[0].sensor.title,
            "ball": f"{describe(pressed[0].indenter)}, {pressed[0].travel}",
            "ball_preset": BALL_PRESET.value,
            "moved": list(moved),
            "pressed": list(pressed),
        },
    )
