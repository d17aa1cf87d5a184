"""The benchmark's scenes in libuipc: as it comes, and alone as it balances best."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import metadata
from tempfile import TemporaryDirectory

from sim.studies.bench.press import stated_scene, within
from sim.studies.bench.scenes import BenchScene, Manner, SceneRow
from tacauchy_rig.core.errors import ConfigError, RigError
from tacauchy_rig.core.parallel import IsolatedWorker, ProcessFailedError
from tests.studies.libuipc.libuipc import press_in_libuipc
from tests.studies.libuipc.pad import PeerPad, peer_pad, peer_press, strayed
from tests.studies.libuipc.task import AS_SHIPPED, STRICT, PeerFound, PeerTask, PeerTolerance

BESIDE_PEER = (1, 60)
"""Environments, where none are asked for."""
_PACKAGE = "pyuipc"
_DEVICE = "cuda:0"
# Of our batches' numbers, those up to this one: it has a pad for each, and sets them up one by one.
_MOST = 60
# Its kernels are compiled in the first press of a machine: two minutes on an H100.
_COMPILE_S = 300.0
# A row takes seconds: what does not end by then is stuck.
_LONGEST_S = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerRow(SceneRow):
    """A scene pressed by libuipc, or why it was not.

    Attributes:
        engine: Its version, and how strictly it solves.
        remark: What else is to be said of the press.
    """

    engine: str
    remark: str = ""


def refuse_without_libuipc(device: str) -> None:
    """End where libuipc cannot run.

    Raises:
        ConfigError: The device is no GPU, or there is no libuipc.
    """
    if device != _DEVICE:
        raise ConfigError(
            f"libuipc has one GPU to itself, not --device {device}",
            remedy=f"give --device {_DEVICE}",
        )
    if importlib.util.find_spec("uipc") is None:
        raise ConfigError("libuipc is not installed", remedy=f"pip install {_PACKAGE}")


def press_in_peer(
    scenes: Sequence[BenchScene],
    counts: Sequence[int],
    *,
    limit_s: float,
    on_progress: Callable[[PeerRow], None],
    backend: str = "cuda",
) -> Iterator[tuple[PeerRow, ...]]:
    """Press one scene after the other in libuipc, in every number of environments; one strictly.

    Args:
        limit_s: After which a row has failed, a minute at most; the first has time to compile
            besides [s].
        backend: libuipc's; ``none`` computes nothing.
    """
    ways = [*((AS_SHIPPED, count) for count in counts if count <= _MOST), (STRICT, 1)]
    limit_s = min(limit_s, _LONGEST_S)
    allowed_s = limit_s + _COMPILE_S
    # Its kernels stay loaded from press to press.
    with IsolatedWorker() as process, TemporaryDirectory(prefix="libuipc-") as folder:
        for scene in scenes:
            pad, rows = _pad(scene), []
            for tolerance, count in ways:
                row = _row(scene, tolerance, count)
                if isinstance(pad, PeerPad):
                    run = partial(press_in_libuipc, folder=folder, backend=backend)
                    row = _pressed(row, pad, tolerance, run=run, process=process, limit_s=allowed_s)
                    allowed_s = limit_s
                else:
                    row = replace(row, failure=pad)
                on_progress(row)
                rows.append(row)
            yield tuple(rows)


def _pad(scene: BenchScene) -> PeerPad | str:
    """Return a scene as libuipc is given it, with the setting of our batches, or why not."""
    try:
        return peer_pad(within(stated_scene(scene.stated), Manner().tolerance)[0])
    except RigError as error:
        return error.message


def _row(scene: BenchScene, tolerance: PeerTolerance, count: int) -> PeerRow:
    try:
        version = metadata.version(_PACKAGE)
    except metadata.PackageNotFoundError:
        version = "of unknown version"
    return PeerRow(
        scene=scene.name,
        manner=Manner(tolerance="", device=_DEVICE, environments=count),
        press=None,
        engine=f"libuipc {version}, {tolerance.name}",
    )


def _pressed(
    row: PeerRow,
    pad: PeerPad,
    tolerance: PeerTolerance,
    *,
    run: Callable[[PeerTask], PeerFound],
    process: IsolatedWorker,
    limit_s: float,
) -> PeerRow:
    task = pad.task(count=row.manner.environments or 1, tolerance=tolerance)
    try:
        found = process.call(partial(run, task), limit_s=limit_s)
    except ProcessFailedError as error:
        process.end()  # what an error leaves on the GPU is not for the next
        return replace(row, failure=error.message.splitlines()[0])
    remark = "; ".join((*found.problems, *strayed(task, found)))
    return replace(row, press=peer_press(pad, task, found), remark=remark)
