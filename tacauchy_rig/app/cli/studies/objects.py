"""``tacauchy-rig objects``: five objects in two sensors, drawn as their cameras see them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from sim.scene.scene import Preset
from tacauchy_rig.app.cli.options import FigureFolder, FigurePage, JsonFile
from tacauchy_rig.app.cli.output import say, writable_folder, write_json, write_text

if TYPE_CHECKING:
    from sim.studies.objects.runs import ObjectPress


_SENSORS = "gelsight-mini,digit"


def objects(
    out: FigureFolder,
    sensors: Annotated[
        str, typer.Option("--sensors", help="Names or files, with commas between.")
    ] = _SENSORS,
    preset: Annotated[Preset, typer.Option("--preset")] = Preset.FAST,
    page: FigurePage = None,
    json_file: JsonFile = None,
) -> None:
    """Press five objects, from sharp edges to smooth curves, and draw dents and tactile images.

    Example: tacauchy-rig study objects --out objects
    """
    from sim.studies.objects.figures import draw_objects
    from sim.studies.objects.runs import DEPTH_M

    writable_folder(out)
    images = None if page is None else writable_folder(page.parent / "images")
    say(f"{DEPTH_M * 1e3:g} mm deep, preset {preset.value}, nominal optics")
    runs = [_on_sensor(name.strip(), preset) for name in sensors.split(",") if name.strip()]
    for path in draw_objects(runs, out, page_folder=images):
        say(f"figure {path}")
    if page is not None:
        command = f"tacauchy-rig objects --out {out} --page {page}"
        command += f" --sensors {sensors}" if sensors != _SENSORS else ""
        command += f" --preset {preset}" if preset is not Preset.FAST else ""
        write_text(page, objects_page(runs, command=command, preset=preset))
        say(f"page {page}")
    rows = [
        {
            "sensor": run.sensor,
            "object": run.name,
            "force_n": run.force_n,
            "highest_over_object_m": run.highest_over_m,
            "processor_s": run.processor_s,
        }
        for sensor in runs
        for run in sensor
    ]
    write_json(json_file, {"preset": preset, "depth_m": DEPTH_M, "presses": rows})


def _on_sensor(name: str, preset: Preset) -> list[ObjectPress]:
    from sim.sensor.sensor import load_sensor
    from sim.studies.objects.runs import press_object
    from sim.studies.objects.shapes import OBJECTS

    sensor = load_sensor(name)
    found = []
    for label in OBJECTS:
        found.append(press_object(label, sensor, preset=preset))
        run = found[-1]
        say(f"  {run.sensor}, {label}: {run.force_n:.3f} N [{run.processor_s:.0f} s]")
    return found


def objects_page(runs: Sequence[Sequence[ObjectPress]], *, command: str, preset: Preset) -> str:
    """Return what was found as a page of Markdown.

    Args:
        runs: Of each sensor the objects in one order.
        command: What makes the page.
    """
    from sim.studies.objects.runs import DEPTH_M
    from sim.studies.objects.shapes import OBJECTS
    from tacauchy_rig.core.page import page as written

    presses = [run for sensor in runs for run in sensor]
    return written(
        "tacauchy_rig.app.cli.studies",
        "objects.md.jinja",
        {
            "command": command,
            "depth_mm": f"{DEPTH_M * 1e3:g}",
            "preset": preset,
            "minutes": f"{sum(run.processor_s for run in presses) / 60.0:.0f}",
            "bodies": OBJECTS,
            "presses": presses,
            "seen_um": _seen_um,
        },
    )


def _seen_um(height_m: float) -> float:
    """Return a height [um]; below a picometre it is rounding."""
    return 0.0 if height_m < 1e-12 else height_m * 1e6
