"""The ``import.toml`` beside an export, so that ``import`` takes it as it is."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tacauchy_rig.app.importing.importer import MESH, PATH_FIELDS, RIG_FIELDS, RIG_TABLES, SPEC_NAME
from tacauchy_rig.app.importing.table import as_toml
from tacauchy_rig.core.config.model import IndenterKind
from tacauchy_rig.core.registry import Kind, unknown
from tacauchy_rig.core.store.durable import write_atomically
from tacauchy_rig.core.store.run_store import RunStore

_EXACT_SHARE = 1e-9


def write_spec(store: RunStore, out: Path, kind: str, data: Mapping[str, object]) -> None:
    """Write what a source of a run's presses says of itself; files that it names come with it."""
    written = store.description["written"]
    rig = {k: v for k, v in written.items() if k in RIG_FIELDS or k.partition(".")[0] in RIG_TABLES}
    rig["replay.indenter"] = indenter_of(store)
    for field in (*PATH_FIELDS, "replay.indenter"):
        rig |= {field: _within(out, field, str(rig[field]))} if rig.get(field) else {}
    head = {"kind": kind, "name": store.config.run.name, "simulated": store.simulated}
    tables = {"data": data, "rig": rig}
    lines = {f"{table}.{k}": v for table, values in tables.items() for k, v in values.items()}
    write_atomically(out / SPEC_NAME, as_toml({**head, **lines}).encode())


def _within(out: Path, field: str, value: str) -> str:
    """Return a value; the file that it names is copied into the export."""
    if field == "replay.indenter" and not value.startswith(MESH):
        return value
    if field == "sensor.name" and not unknown(Kind.SENSOR, value):
        return value
    name, *further = value.removeprefix(MESH).split(",")
    shutil.copy2(name, out / Path(name).name)
    mesh = MESH if value.startswith(MESH) else ""
    return ",".join([f"{mesh}{Path(name).name}", *further])


def indenter_of(store: RunStore) -> str:
    """Return a run's indenter as ``press --indenter`` has it."""
    replay, own = store.config.replay, store.config.indenter
    if replay.indenter is not None:
        return replay.indenter
    size = f"diameter={1e3 * own.diameter:.9g}mm"
    if own.kind is IndenterKind.SPHERE:
        return f"sphere:{size}"
    return f"cylinder:{size},fillet={1e3 * own.fillet:.9g}mm"


def pad_centre(store: RunStore) -> tuple[float, float] | None:
    """Return where the tip is above the pad's centre in the robot's frame [m]; None: not known."""
    if not store.config.is_imported:
        x, y, _ = store.config.sensor.surface
        return x, y
    centres = []
    for index, trial in store.imported_trials.items():
        record = store.counting(index)
        if record is None or trial.place_m is None or record.dwell_start_ns is None:
            return None
        arm = store.recording(index, record.attempt).arm()
        inside = (arm.stamp_ns >= record.dwell_start_ns) & (
            arm.stamp_ns <= (record.dwell_end_ns or 0)
        )
        if not inside.any():
            return None
        centres.append(arm.pose[inside, :2].mean(axis=0) - trial.place_m)
    x, y = np.mean(centres, axis=0).tolist()
    return None if np.ptp(centres, axis=0).max() > _EXACT_SHARE else (x, y)
