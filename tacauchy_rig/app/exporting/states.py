"""The states of a press that ``press --out`` left."""

from __future__ import annotations

from pathlib import Path

from tacauchy_rig.app.replay.press_folder import STATES_NAME
from tacauchy_rig.core.arrays import AnyArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.replay_files import unpack_arrays


def states_of(press: Path) -> dict[str, AnyArray]:
    """Return what ``passed_states`` does, and the sensor's name and the gel's density.

    Raises:
        RecordError: The folder holds none.
    """
    found = unpack_arrays(press / STATES_NAME)
    if not found:
        raise RecordError(
            f"{press}: holds no {STATES_NAME}, the states of a press",
            remedy=f"name a folder of `tacauchy-rig press ... --out {press.name}`",
        )
    return found
