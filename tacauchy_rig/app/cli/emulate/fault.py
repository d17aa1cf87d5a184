"""``tacauchy-rig emulate fault``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drivers.emulators.faults import Device, parse_fault, written_faults
from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import say, write_json


def fault(
    folder: Annotated[Path, typer.Argument(help="The folder that `emulate start` printed.")],
    text: Annotated[
        str,
        typer.Argument(
            metavar="FAULT",
            help="device:kind=amount@start+duration, for example force_sensor:scale=0.1@1s+2s; "
            "all but device and kind may be left out, the amounts below are the usual ones. "
            + " ".join(f"{device}: {written_faults(device)}." for device in Device),
        ),
    ],
    json_file: JsonFile = None,
) -> None:
    """Tell a running emulated device to fail.

    Example: tacauchy-rig emulate fault FOLDER force_sensor:scale=0.1@1s+2s
    """
    from drivers.emulators.process import post_fault

    post_fault(folder, parse_fault(text))
    say(f"told {folder}: {text}")
    write_json(json_file, {"folder": folder, "fault": text})
