"""HDF5 in robomimic's layout: ``data/demo_0`` with observations and actions, one press each.

Beside the even rows that robomimic reads, ``samples`` has all samples at their own times and
``simulated`` the fields of the replay. The attribute ``unit`` says what numbers are in.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from tacauchy_rig.app.exporting.episode import Episode, Rows, even_rows, images_of, needed
from tacauchy_rig.core.arrays import AnyArray
from tacauchy_rig.core.store.run_store import RunStore

WRENCH_UNIT, STATE_UNIT = "N, N, N, N m, N m, N m", "m, m, m, rad, rad, rad"
_UNITS = {"_m": "m", "_pa": "Pa", "_n": "N", "_s": "s"}
_IMAGE = {"compression": "gzip", "compression_opts": 1}


def write_hdf5(presses: Iterable[Episode], out: Path, _store: RunStore | None) -> None:
    """Write presses into ``presses.hdf5``."""
    h5py, episodes = needed("h5py"), list(presses)
    rate, rows = even_rows(episodes)
    with h5py.File(out / "presses.hdf5", "w") as file:
        data = file.create_group("data")
        data.attrs["total"] = sum(len(each.time_s) for each in rows)
        data.attrs["rate_hz"] = rate
        about: dict[str, Any] = {
            "env_name": episodes[0].outputs["sensor"],
            "type": 2,
            "env_kwargs": {},
        }
        data.attrs["env_args"] = json.dumps(about)
        for number, (episode, own) in enumerate(zip(episodes, rows, strict=True)):
            _write_demo(data.create_group(f"demo_{number}"), episode, own)


def _write_demo(group: Any, episode: Episode, rows: Rows) -> None:
    """Write one press."""
    count = len(rows.time_s)
    group.attrs["num_samples"] = count
    for name, value in episode.outputs.items():
        group.attrs[name] = np.nan if value is None else value
    for name, (start_ns, end_ns) in episode.windows.items():
        group.attrs[f"{name}_ns"] = [start_ns, end_ns]
    units = {"obs/time": "s", "obs/wrench": WRENCH_UNIT, "obs/wrench_window": WRENCH_UNIT}
    values: dict[str, AnyArray] = {"obs/time": rows.time_s, "obs/wrench": rows.wrench}
    values["obs/wrench_window"] = rows.window
    ends = (np.arange(count) == count - 1).astype(np.int64)
    values |= {"dones": ends, "rewards": np.zeros(count), "samples/image_stamp": episode.stamps_ns}
    samples = {"force": (episode.force, WRENCH_UNIT), "pose": (episode.pose, STATE_UNIT)}
    for name, (stream, unit) in samples.items():
        if stream is not None:
            values |= {f"samples/{name}": stream.value, f"samples/{name}_stamp": stream.stamp_ns}
            units |= {f"samples/{name}": unit, f"samples/{name}_stamp": "ns"}
    if rows.state is not None:
        values |= {"obs/state": rows.state, "actions": np.vstack([rows.state[1:], rows.state[-1:]])}
        units |= {"obs/state": STATE_UNIT, "actions": STATE_UNIT}
    units["samples/image_stamp"] = "ns"
    for name, array in episode.fields().items():
        values[f"simulated/{name}"] = array
        units |= {f"simulated/{name}": unit for end, unit in _UNITS.items() if name.endswith(end)}
    for name, array in values.items():
        group.create_dataset(name, data=array).attrs["unit"] = units.get(name, "1")
    images = None
    for number, image in enumerate(images_of(episode, rows)):
        if images is None:
            shape = (count, *image.shape)
            images = group.create_dataset(
                "obs/tactile", shape, np.uint8, chunks=(1, *image.shape), **_IMAGE
            )
            images.attrs["unit"] = "grey levels, RGB"
        images[number] = image
