"""``tacauchy-rig bench``: how long the simulator's work takes on this machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from sim.scene.scene import Preset, SceneTerms
from sim.studies.bench.part import REFERENCE_FILE, SCENE_LIMIT_S, Part
from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import (
    complain,
    say,
    show_table,
    writable_folder,
    write_json,
    write_text,
)
from tacauchy_rig.core.versions import machine, versions

_PUNCH = "cylinder:diameter=5mm,fillet=0.1mm"


_Parts = Annotated[
    list[Part] | None,
    typer.Option("--part", metavar="PART", help=f"Only this; may be repeated. {', '.join(Part)}."),
]
_Only = Annotated[
    list[str] | None,
    typer.Option(
        "--only",
        metavar="PATTERN",
        help="Of the scenes: those named so; may be repeated.",
    ),
]
_Drawn = Annotated[
    int | None,
    typer.Option(
        "--drawn",
        metavar="SEED",
        help="Of the scenes: a dozen that are drawn at random instead of the table's.",
    ),
]
_Tolerances = Annotated[
    list[str] | None,
    typer.Option(
        "--tolerance",
        metavar="5%|1%",
        help="Of the scenes: what their presets are chosen for (5%); may be repeated.",
    ),
]
_Device = Annotated[str, typer.Option("--device", help="Of the scenes: cpu or cuda:0.")]
_Environments = Annotated[
    list[int] | None,
    typer.Option(
        "--environments",
        metavar="N",
        min=1,
        help="Of the scenes: so many in a batch, instead of one press alone; may be repeated.",
    ),
]
_Images = Annotated[
    bool,
    typer.Option(
        "--images",
        help="Of the scenes in batches: with the camera's image, the markers and the surface's "
        "stress in every frame.",
    ),
]
_OwnMesh = Annotated[
    bool,
    typer.Option(
        "--own-mesh",
        help="Of the scenes in batches: on the mesh that a batch makes itself, the same for every "
        "tolerance.",
    ),
]
_Reference = Annotated[
    bool,
    typer.Option(
        "--reference",
        help="Of the scenes: first press with preset reference, and keep that beside the page.",
    ),
]
_Against = Annotated[
    Path | None,
    typer.Option(
        "--against",
        metavar="FILE",
        help=f"Of the scenes: what forces are compared with; else OUT/{REFERENCE_FILE}.",
    ),
]
_Limit = Annotated[
    float,
    typer.Option(
        "--limit",
        metavar="SECONDS",
        help="Of the scenes: each ends by then.",
    ),
]


def bench(
    out: Annotated[Path, typer.Option("--out", help="Folder for figure, page and JSON.")] = Path(
        "bench"
    ),
    sensor: Annotated[str, typer.Option("--sensor")] = "gelsight-mini",
    indenter: Annotated[str, typer.Option("--indenter")] = _PUNCH,
    parts: _Parts = None,
    only: _Only = None,
    drawn: _Drawn = None,
    tolerances: _Tolerances = None,
    device: _Device = "cpu",
    environments: _Environments = None,
    images: _Images = False,
    own_mesh: _OwnMesh = False,
    reference: _Reference = False,
    against: _Against = None,
    limit_s: _Limit = SCENE_LIMIT_S,
    json_file: JsonFile = None,
) -> None:
    """Time images, a replay, growth, scenes, start-up and threads; takes minutes.

    Example: tacauchy-rig study bench --part scenes --only ball
    """
    writable_folder(out)
    wanted = parts or list(Part)
    if Part.SCENES in wanted:
        from tacauchy_rig.app.cli.studies.bench_scenes import ScenesAsked, bench_scenes

        asked = ScenesAsked(
            only=tuple(only or ()),
            drawn=drawn,
            tolerances=tuple(tolerances or ("5%",)),
            device=device,
            environments=tuple(environments or ()),
            images=images,
            own_mesh=own_mesh,
            reference=reference,
            against=against,
            limit_s=limit_s,
        )
        bench_scenes(asked, out=out, json_file=json_file if wanted == [Part.SCENES] else None)
    others = [part for part in wanted if part is not Part.SCENES]
    if others:
        _bench_parts(out, sensor, indenter, others, json_file, is_all=parts is None)


def _bench_parts(
    out: Path,
    sensor: str,
    indenter: str,
    parts: Sequence[Part],
    json_file: Path | None,
    *,
    is_all: bool,
) -> None:
    """Measure, show and write everything but the scenes."""
    from sim.press_command import scene_of
    from sim.sensor.sensor import load_sensor
    from sim.studies.bench.figure import draw_bench
    from sim.studies.bench.suite import run_bench
    from sim.studies.bench.tables import bench_tables
    from tacauchy_rig.app.replay.rendering import replay_images
    from tacauchy_rig.core.config.load import load_config
    from tacauchy_rig.core.page import criteria_page

    gel = load_sensor(sensor)
    terms = SceneTerms(indenter=indenter, sensor=sensor, depth="1mm", preset=Preset.FAST)
    found = run_bench(
        scene_of(terms),
        replay_images(gel),
        load_config(None).config.protocol.force_targets,
        parts=parts,
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
                *(f"--part {part}" for part in parts if not is_all),
                f"--out {out}",
            ]
        ),
    )
    write_text(out / "bench.md", page)
    for file in (*drawn, out / "bench.json", out / "bench.md"):
        say(str(file))
