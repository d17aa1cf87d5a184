"""``export``: runs, presses, calibrations and sensors in other programs' formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import say, write_json
from tacauchy_rig.app.exporting.names import Format


def export(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="RUN|DATASET|PRESS|CALIBRATION",
            help="A run's folder; that of a sweep (lerobot, hdf5, rosbag2, webdataset); one of "
            "`press --out` (vtu, usd); what `calibrate optics` wrote, or a sensor's name for its "
            "optics (isaaclab, taxim, tacex), body (usd) or pressure-law.",
        ),
    ],
    out: Annotated[Path, typer.Argument(metavar="FOLDER", help="A new folder to write to.")],
    to: Annotated[Format, typer.Option(help="The format to write.")] = Format.CSV,
    sensor: Annotated[str, typer.Option(help="The sensor that was calibrated.")] = "gelsight-mini",
    background: Annotated[
        Path | None,
        typer.Option(metavar="IMAGE", help="Its no-contact frame; without it, even grey."),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Write what other programs read.

    Example: tacauchy-rig export runs/20261123-gelsight-mini exported --to lerobot
    """
    from tacauchy_rig.app.exporting.formats import export as write
    from tacauchy_rig.core.long_task import doing

    with doing("exporting"):
        write(source, out, to, sensor=sensor, background=background)
    written = sorted(path for path in out.rglob("*") if path.is_file())
    size_mb = sum(path.stat().st_size for path in written) / 1e6
    say(f"wrote {len(written)} files, {size_mb:.1f} MB, to {out}")
    write_json(json_file, {"files": written})
