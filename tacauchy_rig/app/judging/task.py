"""What a run asks of a simulator, in plain files: the presses, without the images to be met."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tacauchy_rig.core.outputs import AskedPress, Task
from tacauchy_rig.core.rgb import encode_png
from tacauchy_rig.core.store.durable import write_atomically

TASK, PRESSES, NO_CONTACT = "task.toml", "presses.csv", "no_contact.png"


def write_task(
    folder: Path,
    task: Task,
    presses: list[AskedPress],
    references: Mapping[int, NDArray[np.uint8]],
) -> None:
    """Write what a simulator needs to know; SI, units in the names.

    Args:
        references: No-contact frames by press, of the scored size.

    Raises:
        RecordError: The folder cannot be written.
    """
    lines = [f"{key} = {json.dumps(value)}" for key, value in asdict(task).items()]
    write_atomically(folder / TASK, "\n".join([*lines, ""]).encode())
    head = [each.name for each in fields(AskedPress)]
    rows = [",".join(map(_cell, asdict(press).values())) for press in presses]
    write_atomically(folder / PRESSES, "\n".join([",".join(head), *rows, ""]).encode())
    for trial, image in references.items():
        write_atomically(folder / f"{trial:02d}" / NO_CONTACT, encode_png(image))


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f'"{value}"' if isinstance(value, str) else str(value)
