"""``tacauchy-rig bench``: how long the simulator's work takes on this machine."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from sim.scene.scene import Preset
from sim.scene.scene_terms import SceneTerms
from sim.studies.bench.part import Part, Peer
from tacauchy_rig.cli.options import JsonFile
from tacauchy_rig.cli.output import (
    complain,
    say,
    show_table,
    writable_folder,
    write_json,
    write_text,
)
from tacauchy_rig.versions import machine, versions

_PUNCH = "cylinder:diameter=5mm,fillet=0.1mm"


def bench(
    out: Annotated[Path, typer.Option("--out", help="Folder for figure, page and JSON.")] = Path(
        "bench"
    ),
    sensor: Annotated[str, typer.Option("--sensor")] = "gelsight-mini",
    indenter: Annotated[str, typer.Option("--indenter")] = _PUNCH,
    parts: Annotated[
        list[Part] | None, typer.Option("--part", help="Only this; may be repeated.")
    ] = None,
    peer: Annotated[
        Peer | None,
        typer.Option(
            "--peer",
            help="Run the batches' press by this engine too, on the same GPU after ours, with its "
            "force and balance beside its time; libuipc comes with pip install pyuipc.",
        ),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Time frames, what reuse saves, batches, parts, a replay, and growth; minutes."""
    from sim.optics.camera_geometry import camera_geometry
    from sim.optics.render.renderer import nominal_renderer
    from sim.press_command import scene_of
    from sim.sensor.sensor import load_sensor
    from sim.studies.bench.figure import draw_bench
    from sim.studies.bench.suite import run_bench
    from sim.studies.bench.tables import bench_tables
    from tacauchy_rig.config.load import load_config
    from tacauchy_rig.loop.rendering import replay_images
    from tacauchy_rig.page import criteria_page

    writable_folder(out)
    gel = load_sensor(sensor)
    terms = SceneTerms(indenter=indenter, sensor=sensor, depth="1mm", preset=Preset.FAST)
    found = run_bench(
        scene_of(terms),
        camera_geometry(gel),
        nominal_renderer(gel),
        replay_images(gel),
        load_config(None).config.protocol.force_targets,
        parts=tuple(parts or Part),
        peer=peer,
        on_progress=lambda text: complain(f"  {text}"),
    )
    tables = bench_tables(found)
    for table in tables:
        show_table(table)
    for text in found.absent:
        say(f"not measured: {text}")
    facts = {**asdict(found), "machine": machine(), "versions": versions()}
    write_json(out / "bench.json", facts)
    write_json(json_file, facts)
    drawn = draw_bench(found, folder=out)
    page = criteria_page(
        tables,
        title="Benchmark",
        note=f"{indenter} into {sensor}.",
        image=next((file.name for file in drawn if file.suffix == ".png"), ""),
        command=" ".join(
            [
                f"tacauchy-rig bench --sensor {sensor} --indenter {indenter}",
                *(f"--part {part}" for part in parts or ()),
                *([f"--peer {peer}"] if peer else []),
                f"--out {out}",
            ]
        ),
    )
    write_text(out / "bench.md", page)
    for file in (*drawn, out / "bench.json", out / "bench.md"):
        say(str(file))
