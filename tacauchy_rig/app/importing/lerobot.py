"""LeRobot datasets of version 3: numbers in Parquet, images as videos or within it.

``meta/info.json`` lists the features, ``meta/episodes`` where each episode lies, ``data`` and
``videos`` hold many episodes a file. Field names and layout as of codebase_version v3.0.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from tacauchy_rig.app.importing.presses import (
    Frame,
    Press,
    PressFinding,
    Recorded,
    S,
    Samples,
    Streams,
    cut,
    drift_note,
    find_presses,
    needed,
)
from tacauchy_rig.app.importing.source import IMAGE_BYTES, LARGE_BYTES, MIB, Source
from tacauchy_rig.app.importing.table import unit_factor
from tacauchy_rig.app.importing.video import png_frames
from tacauchy_rig.core.arrays import BoolArray, FloatArray, Int64Array
from tacauchy_rig.core.config.fields import Section
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.quantities import Dimension

if TYPE_CHECKING:
    import pyarrow


FILE_BYTES = 1024 * MIB
UNPACKED_BYTES = 4096 * MIB
"""Of the columns that are read, as the file's foot says."""
ROWS_MOST = 2_000_000
EXTRA = "lerobot"


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of some columns.

    Attributes:
        name: Of the file, for messages.
        table: As Arrow has them.
    """

    name: str
    table: pyarrow.Table

    def rows(self) -> Iterator[Mapping[str, Any]]:
        """Yield each row by column."""
        yield from self.table.to_pylist()

    def numbers(self, column: str) -> FloatArray:
        """Return a column of numbers, or of lists of as many numbers each, shape [n, k].

        Raises:
            RecordError: It holds something else.
        """
        cells = self.table.column(column).to_pylist()
        try:
            values = np.array(cells, dtype=np.float64).reshape(len(cells), -1)
        except (TypeError, ValueError) as error:
            raise RecordError(
                f"{self.name}: {column}: no numbers, or not as many in each row",
                remedy="name a feature of numbers",
            ) from error
        return values

    def image(self, column: str, row: int, *, most_bytes: int) -> bytes:
        """Return the bytes of an image that stands in a cell.

        Raises:
            RecordError: There are none, or too many.
        """
        cell = self.table.column(column)[row].as_py()
        data = cell.get("bytes") if isinstance(cell, dict) else None
        if not isinstance(data, bytes) or not 0 < len(data) <= most_bytes:
            raise RecordError(
                f"{self.name}: {column}, row {row}: holds no image's bytes",
                remedy="images have to lie within the file; paths to others are not followed",
            )
        return data


def read_parquet(
    source: Source, name: str, columns: Sequence[str], *, where: tuple[str, int] | None = None
) -> Rows:
    """Return columns of a file, and of them the rows whose column has a value.

    Raises:
        RecordError: It is none, lacks a column, or unpacks to too much.
        ConfigError: ``pyarrow`` is not there.
    """
    try:
        arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError as error:
        raise ConfigError(
            f"{name}: Parquet is read by pyarrow, which is not installed",
            remedy=f'pip install "tacauchy-rig[{EXTRA}]", or: pip install pyarrow',
        ) from error
    path = source.path(name, field="the dataset", most_bytes=FILE_BYTES)
    try:
        with parquet.ParquetFile(path) as file:
            _check_size(file, name, columns)
            table = file.read(columns=list(columns), use_threads=False)
        if where is not None:
            kept = np.flatnonzero(np.asarray(table.column(where[0])) == where[1])
            table = table.take(kept)
    except (arrow.ArrowException, OSError, ValueError, MemoryError) as error:
        raise RecordError(
            f"{name}: no whole Parquet file: {str(error)[:200]}",
            remedy="copy it anew from its source",
        ) from error
    return Rows(name, table)


def _check_size(file: Any, name: str, columns: Sequence[str]) -> None:
    """Refuse what the file's foot says to be too large, before anything of it is unpacked."""
    foot = file.metadata
    there = set(file.schema_arrow.names)
    if missing := [each for each in columns if each not in there]:
        raise RecordError(
            f"{name}: has no column {', '.join(missing)[:200]}",
            remedy=f"its columns: {', '.join(file.schema_arrow.names)[:300]}",
        )
    groups = [foot.row_group(k) for k in range(foot.num_row_groups)]
    size = sum(
        group.column(k).total_uncompressed_size
        for group in groups
        for k in range(group.num_columns)
        if group.column(k).path_in_schema.partition(".")[0] in columns
        or group.column(k).path_in_schema in columns
    )
    if foot.num_rows > ROWS_MOST or not 0 <= size <= UNPACKED_BYTES:
        raise RecordError(
            f"{name}: {foot.num_rows} rows of {size} bytes; at most {ROWS_MOST} of "
            f"{UNPACKED_BYTES} are read",
            remedy="split the dataset",
        )


VERSION = "v3."
INFO = "meta/info.json"
EPISODES = "meta/episodes"
DATA = "data/chunk-{chunk:03d}/file-{file:03d}.parquet"
VIDEOS = "videos/{key}/chunk-{chunk:03d}/file-{file:03d}.mp4"
EPISODES_MOST = 1000
"""That a run takes: `data.episodes` names some of more."""


class Feature(Section):
    """A feature with numbers.

    Attributes:
        feature: Its name in the dataset.
        unit: Of its lengths or forces.
        first: Which of its numbers is the first of ours.
    """

    feature: str
    unit: str
    first: int = Field(default=0, ge=0, lt=1000)


class LeRobotData(Section):
    """``[data]`` of a LeRobot dataset.

    Attributes:
        image: Feature with the tactile images; left out, the only one of images.
        force: Fx, Fy, Fz and, if there are six, moments; one number is Fz.
        moment_unit: Of the moments.
        pose: x, y and z of the tip, z upwards; may be missing.
        episodes: Which to take; left out, all.
    """

    image: str | None = None
    force: Feature
    moment_unit: str = "N m"
    pose: Feature | None = None
    episodes: tuple[int, ...] = ()
    presses: PressFinding = Field(default_factory=PressFinding)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Dataset:
    """What ``meta`` says.

    Attributes:
        features: By name, as ``info.json`` has them.
        episodes: A row each, of those that are taken.
    """

    features: Mapping[str, Mapping[str, Any]]
    rate_hz: float
    episodes: Sequence[Mapping[str, Any]]
    image: str


def read_lerobot(source: Source, data: LeRobotData) -> Recorded:
    """Read a dataset's episodes, and find the presses of each by its force.

    Raises:
        RecordError: A file is missing or damaged, or an episode has no press.
        ConfigError: A feature or a unit is not what is said.
    """
    dataset = _dataset(source, data)
    presses: list[Press] = []
    for episode in dataset.episodes:
        with source.problems.noting():
            presses += _presses(source, data, dataset, episode)
    return Recorded(
        presses=tuple(presses),
        has_clock=True,
        unknown=tuple(_unknown(data)),
        notes=(_FOUND.format(presses=len(presses), episodes=len(dataset.episodes)),),
        contact_force_n=data.presses.contact_force,
        name="lerobot",
    )


_FOUND = (
    "{presses} presses were found by the force in {episodes} episodes. Each row has the newest "
    "force, pose and image of its moment, at the dataset's rate: their age is not recorded. A "
    "press counts as held while the force is nearly its largest, which no protocol judged."
)


def _unknown(data: LeRobotData) -> Iterator[str]:
    yield "How much later than the moment itself force and images are stamped is not known."
    if data.pose is None:
        yield "The depth is not known."
    yield "Where on the pad was pressed is not known."


def _dataset(source: Source, data: LeRobotData) -> _Dataset:
    info = _info(source)
    features = info["features"]
    images = [name for name, each in features.items() if each.get("dtype") in ("image", "video")]
    wanted = images if data.image is None else [each for each in images if each == data.image]
    if len(wanted) != 1:
        raise ConfigError(
            f"data.image: {data.image or 'the only feature of images'!r} is none of {INFO}",
            remedy=f"name one of: {', '.join(images)[:300] or 'there is none'}",
        )
    found = {
        int(row["episode_index"]): row
        for path in _parquets(source)
        for row in read_parquet(source, path, _columns(wanted[0], features)).rows()
    }
    missing = [str(index) for index in data.episodes if index not in found]
    taken = data.episodes or tuple(sorted(found))
    if missing or not 0 < len(taken) <= EPISODES_MOST:
        raise RecordError(
            f"data.episodes: {EPISODES} has {len(found)} episodes"
            + (f", not {', '.join(missing)[:200]}" if missing else ""),
            remedy=f"name up to {EPISODES_MOST} of them as data.episodes",
        )
    return _Dataset(
        features=features,
        rate_hz=float(info["fps"]),
        episodes=[found[index] for index in taken],
        image=wanted[0],
    )


def _info(source: Source) -> dict[str, Any]:
    """Return ``info.json``; its templates of paths have to be those of version 3, as ours are."""
    text = source.read(INFO, field="the dataset", most_bytes=MIB)
    try:
        info = json.loads(text)
        version, rate = str(info["codebase_version"]), float(info["fps"])
        features = dict(info["features"])
        whole = all(isinstance(each, dict) for each in features.values())
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise RecordError(
            f"{INFO}: damaged, or no LeRobot dataset's: {type(error).__name__} {str(error)[:100]}",
            remedy="it has codebase_version, fps and features",
        ) from error
    if not version.startswith(VERSION) or not whole or not 0.0 < rate < 1e4:
        raise RecordError(
            f"{INFO}: codebase_version {version[:20]!r}, {rate:g} rows a second",
            remedy="datasets of version 3 are read: convert it with LeRobot's own tools",
        )
    return info if isinstance(info, dict) else {}


def _parquets(source: Source) -> list[str]:
    folder = source.folder(EPISODES, field="the dataset")
    return [str(path.relative_to(source.root)) for path in sorted(folder.glob("*/[!.]*.parquet"))]


def _columns(image: str, features: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the columns of an episode's row that are needed."""
    columns = ["episode_index", "data/chunk_index", "data/file_index"]
    if features[image]["dtype"] == "video":
        of_video = ("chunk_index", "file_index", "from_timestamp")
        columns += [f"videos/{image}/{name}" for name in of_video]
    return columns


def _presses(
    source: Source, data: LeRobotData, dataset: _Dataset, episode: Mapping[str, Any]
) -> Iterator[Press]:
    index = int(episode["episode_index"])
    rows = _rows(source, data, dataset, episode)
    stamp_ns = _stamps(rows, index)
    factor = unit_factor(data.force.unit, Dimension.FORCE, field="data.force.unit")
    turn = unit_factor(data.moment_unit, Dimension.TORQUE, field="data.moment_unit")
    wrench = _wrench(rows.numbers(data.force.feature), data.force, factor, turn)
    force = _finite(
        source, stamp_ns, wrench, wrench[:, 2], f"episode {index}: {data.force.feature}"
    )
    pose = None
    if data.pose is not None:
        metres = unit_factor(data.pose.unit, Dimension.LENGTH, field="data.pose.unit")
        placed = metres * _components(rows.numbers(data.pose.feature), data.pose, 3)
        padded = np.pad(placed, ((0, 0), (0, 3)), constant_values=np.nan)
        where = f"episode {index}: {data.pose.feature}"
        pose = _finite(source, stamp_ns, padded, placed.sum(axis=1), where)
    try:
        found = find_presses(force, data.presses)
        frames = _frames(source, dataset, episode, rows, stamp_ns, needed(stamp_ns, found))
        source.notes += [f"Episode {index}: {note}" for note in drift_note(found)]
        for press in cut(Streams(force=force, frames=frames, pose=pose), found):
            yield replace(press, name=f"episode {index}, {press.name}")
    except RecordError as error:
        raise RecordError(f"episode {index}: {error.message}", remedy=error.remedy) from error


def _finite(
    source: Source, stamp_ns: Int64Array, values: FloatArray, told_by: FloatArray, where: str
) -> Samples:
    """Return the rows with finite numbers; how many were left out is noted.

    Raises:
        RecordError: There is none.
    """
    known = np.isfinite(told_by)
    if not known.any():
        raise RecordError(f"{where}: holds no finite numbers", remedy="leave this episode out")
    if not known.all():
        lost = f"{int((~known).sum())} of {len(known)} rows hold no finite numbers"
        source.notes.append(f"{where}: {lost} and were left out.")
    return Samples(stamp_ns=stamp_ns[known], value=values[known])


def _rows(source: Source, data: LeRobotData, dataset: _Dataset, episode: Mapping[str, Any]) -> Rows:
    """Return the rows of an episode."""
    columns = ["episode_index", "timestamp", data.force.feature]
    columns += [data.pose.feature] if data.pose else []
    columns += [dataset.image] if dataset.features[dataset.image]["dtype"] == "image" else []
    for name in columns[2:]:
        if name not in dataset.features:
            raise ConfigError(
                f"data: {name!r} is no feature of {INFO}",
                remedy=f"its features: {', '.join(dataset.features)[:300]}",
            )
    path = DATA.format(chunk=int(episode["data/chunk_index"]), file=int(episode["data/file_index"]))
    return read_parquet(
        source, path, columns, where=("episode_index", int(episode["episode_index"]))
    )


def _stamps(rows: Rows, index: int) -> Int64Array:
    time_s = rows.numbers("timestamp")[:, 0]
    if not len(time_s) or not (np.diff(time_s) > 0.0).all():
        raise RecordError(
            f"episode {index}: has {len(time_s)} rows whose timestamps do not ascend",
            remedy="the dataset is damaged: leave the episode out with data.episodes",
        )
    return np.asarray(np.rint((time_s - time_s[0] + 1.0) * S), dtype=np.int64)


def _components(values: FloatArray, feature: Feature, count: int) -> FloatArray:
    """Return some numbers of a feature, shape [n, count]."""
    end = feature.first + count
    if values.shape[1] < end:
        raise ConfigError(
            f"{feature.feature}: has {values.shape[1]} numbers; {feature.first} to {end - 1} are "
            "wanted",
            remedy="correct `first`: which of its numbers is the first that is wanted",
        )
    return values[:, feature.first : end]


def _wrench(values: FloatArray, feature: Feature, newton: float, newton_metre: float) -> FloatArray:
    """Return wrenches: one number is Fz, three are forces, six are forces and moments."""
    wrench = np.full((len(values), 6), np.nan)
    left = values.shape[1] - feature.first
    if left == 1:
        wrench[:, 2] = newton * _components(values, feature, 1)[:, 0]
        return wrench
    wrench[:, :3] = newton * _components(values, feature, 3)
    if left >= 6:
        wrench[:, 3:] = newton_metre * _components(values, feature, 6)[:, 3:]
    return wrench


def _frames(
    source: Source,
    dataset: _Dataset,
    episode: Mapping[str, Any],
    rows: Rows,
    stamp_ns: Int64Array,
    wanted: BoolArray,
) -> tuple[Frame, ...]:
    """Return the frames that are at rest or held."""
    key, index = dataset.image, int(episode["episode_index"])
    if dataset.features[key]["dtype"] == "image":
        kept = np.flatnonzero(wanted).tolist()
        return tuple(
            Frame(
                stamp_ns=int(stamp_ns[row]),
                name=f"{key} {index}/{row}",
                read=partial(bytes, rows.image(key, row, most_bytes=IMAGE_BYTES)),
            )
            for row in kept
        )
    at = {name: episode[f"videos/{key}/{name}"] for name in ("chunk_index", "file_index")}
    name = VIDEOS.format(key=key, chunk=int(at["chunk_index"]), file=int(at["file_index"]))
    path = source.path(name, field=f"episode {index}", most_bytes=LARGE_BYTES)
    time_s = rows.numbers("timestamp")[:, 0] + float(episode[f"videos/{key}/from_timestamp"])
    numbers = np.rint(time_s * dataset.rate_hz).astype(np.int64)
    stamps = {int(numbers[row]): int(stamp_ns[row]) for row in np.flatnonzero(wanted)}
    found = png_frames(path, name, stamps)
    if len(found) < len(stamps):
        raise RecordError(
            f"{name}: {len(found)} of the {len(stamps)} frames that are wanted can be read, up to "
            f"frame {int(numbers[-1])}",
            remedy="the video was cut off, or its codec is not read here: convert it with "
            "`ffmpeg -c:v ffv1`, keeping its name, or to H.264",
        )
    return found
