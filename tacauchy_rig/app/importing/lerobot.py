"""LeRobot datasets of version 3: numbers in Parquet, images as videos or within it.

``meta/info.json`` lists the features, ``meta/episodes`` where each episode lies, ``data`` and
``videos`` hold many episodes a file. Field names and layout as of codebase_version v3.0.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from tacauchy_rig.app.importing import press_detection as detection
from tacauchy_rig.app.importing.source_files import IMAGE_BYTES, LARGE_BYTES, MIB, Source, at_most
from tacauchy_rig.app.importing.text_tables import unit_factor
from tacauchy_rig.app.importing.video_and_clock_offset import png_frames
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.field_ranges import Section
from tacauchy_rig.core.errors import ConfigError, RecordError, naming, whole
from tacauchy_rig.core.quantities import Dimension
from tacauchy_rig.core.versions import library

if TYPE_CHECKING:
    import pyarrow

FILE_BYTES = 1024 * MIB
UNPACKED_BYTES = 4096 * MIB
"""Of a file's columns, as its foot says."""
ROWS_MOST = 2_000_000
VERSION = "v3."
INFO = "meta/info.json"
EPISODES = "meta/episodes"
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
DATA, VIDEOS = f"data/{_FILE}.parquet", f"videos/{{video_key}}/{_FILE}.mp4"
PLACE = ("chunk_index", "file_index")
"""Of a file, by which an episode names it."""
EPISODES_MOST = 1000
"""That a run takes: `data.episodes` names some of more."""
INDEX, TIME = "episode_index", "timestamp"
_FOUND = (
    "{presses} presses were found by the force in {episodes} episodes. Each row has the newest "
    "force, pose and image of its moment, at the dataset's rate: their age is not recorded. A "
    "press counts as held while the force is nearly its largest, which no protocol judged."
)


class Feature(Section):
    """A feature with numbers, and which of them is the first of ours."""

    feature: str
    unit: str
    first: int = Field(default=0, ge=0, lt=1000)


class LeRobotData(Section):
    """``[data]`` of a LeRobot dataset."""

    image: str | None = None
    force: Feature
    moment_unit: str = "N m"
    pose: Feature | None = None
    episodes: tuple[int, ...] = ()
    presses: detection.PressFinding = Field(default_factory=detection.PressFinding)


def read_lerobot(source: Source, data: LeRobotData) -> detection.Recorded:
    """Read a dataset's episodes, and find the presses of each by its force.

    Raises:
        RecordError: A file is missing or damaged, or an episode has no press.
        ConfigError: A feature or a unit is not what is said.
    """
    info = _info(source)
    image = _image_feature(info, data)
    episodes = _episodes(source, data, image, is_video=info["features"][image]["dtype"] == "video")
    presses: list[detection.Press] = []
    for episode in episodes:
        with source.problems.noting():
            presses += _presses(source, data, info, image, episode)
    return detection.Recorded(
        presses=tuple(presses),
        has_clock=True,
        unknown=("The delays of force and images are not known.",),
        notes=(_FOUND.format(presses=len(presses), episodes=len(episodes)),),
        contact_force_n=data.presses.contact_force,
        name="lerobot",
    )


def _info(source: Source) -> dict[str, Any]:
    """Return ``info.json``; its templates of paths have to be those of version 3, as ours are."""
    text = source.read(INFO, field="the dataset", most_bytes=MIB)
    with whole(INFO, "dataset's information", remedy="it has codebase_version, fps and features"):
        info: dict[str, Any] = json.loads(text)
        version, rate = str(info["codebase_version"]), float(info["fps"])
        has_kinds = all("dtype" in each for each in dict(info["features"]).values())
    if not version.startswith(VERSION) or not has_kinds or not 0.0 < rate < 1e4:
        raise RecordError(
            f"{INFO}: codebase_version {version[:20]!r}, {rate:g} rows a second",
            remedy="datasets of version 3 are read: convert it with LeRobot's own tools",
        )
    return info


def _image_feature(info: Mapping[str, Any], data: LeRobotData) -> str:
    """Return the feature with the images, of those that are stated."""
    features: Mapping[str, Mapping[str, Any]] = info["features"]
    images = [name for name, each in features.items() if each.get("dtype") in ("image", "video")]
    wanted = [each for each in images if data.image in (None, each)]
    if len(wanted) != 1:
        raise ConfigError(
            f"data.image: {data.image or 'the only feature of images'!r} is none of {INFO}",
            remedy=f"name one of: {', '.join(images)[:300] or 'there is none'}",
        )
    return wanted[0]


def _episodes(
    source: Source, data: LeRobotData, image: str, *, is_video: bool
) -> list[dict[str, Any]]:
    """Return where the episodes that are taken lie."""
    columns = [INDEX, *(f"data/{n}" for n in PLACE)]
    if is_video:
        columns += [f"videos/{image}/{n}" for n in (*PLACE, "from_timestamp")]
    folder = source.root / source.prefix(EPISODES, field="the dataset")
    found: dict[int, dict[str, Any]] = {}
    for path in sorted(folder.glob("*/[!.]*.parquet")):
        rows = _read_parquet(source, str(path.relative_to(source.root)), columns).to_pylist()
        found |= {int(row[INDEX]): row for row in rows}
    missing = [str(index) for index in data.episodes if index not in found]
    taken = data.episodes or tuple(sorted(found))
    if missing or not 0 < len(taken) <= EPISODES_MOST:
        raise RecordError(
            f"data.episodes: {EPISODES} has {len(found)} episodes"
            + (f", not {', '.join(missing)[:200]}" if missing else ""),
            remedy=f"name up to {EPISODES_MOST} of them as data.episodes",
        )
    return [found[index] for index in taken]


def _read_parquet(source: Source, name: str, columns: Sequence[str]) -> pyarrow.Table:
    """Return columns of a file."""
    parquet = library("pyarrow.parquet", extra="lerobot")
    path = source.path(name, field="the dataset", most_bytes=FILE_BYTES)
    with whole(name, "Parquet file"), parquet.ParquetFile(path) as file:
        foot, there = file.metadata, file.schema_arrow.names
        if missing := [each for each in columns if each not in there]:
            raise RecordError(
                f"{name}: has no column {', '.join(missing)[:200]}",
                remedy=f"its columns: {', '.join(there)[:300]}",
            )
        at_most(ROWS_MOST, foot.num_rows, f"{name}: {foot.num_rows} rows")
        size = sum(foot.row_group(k).total_byte_size for k in range(foot.num_row_groups))
        at_most(UNPACKED_BYTES, size, f"{name}: unpacks to {size} bytes")
        return file.read(columns=list(columns), use_threads=False)


def _presses(
    source: Source,
    data: LeRobotData,
    info: Mapping[str, Any],
    image: str,
    episode: Mapping[str, Any],
) -> list[detection.Press]:
    """Return an episode's presses."""
    index = int(episode[INDEX])
    columns = [INDEX, TIME, data.force.feature]
    columns += [data.pose.feature] if data.pose else []
    columns += [image] if info["features"][image]["dtype"] == "image" else []
    name = DATA.format(**{n: int(episode[f"data/{n}"]) for n in PLACE})
    table = _read_parquet(source, name, columns)
    table = table.take(np.flatnonzero(np.asarray(table.column(INDEX)) == index))
    time_s = _numbers(table, name, TIME)[:, 0]
    if not len(time_s) or not (np.diff(time_s) > 0.0).all():
        raise RecordError(
            f"episode {index}: has {len(time_s)} rows whose timestamps do not ascend",
            remedy="the dataset is damaged: leave the episode out with data.episodes",
        )
    stamp_ns = np.asarray(np.rint((time_s - time_s[0] + 1.0) * detection.S), dtype=np.int64)
    wrench = _wrench(table, name, data)
    where, notes = f"episode {index}: ", source.notes
    known = np.isfinite(wrench[:, 2])
    force = detection.known_samples(stamp_ns, wrench, known, where + data.force.feature, notes)
    pose = None
    if data.pose is not None:
        metres = unit_factor(data.pose.unit, Dimension.LENGTH, field="data.pose.unit")
        placed = metres * _numbers(table, name, data.pose.feature, data.pose.first, (3,))
        padded = np.pad(placed, ((0, 0), (0, 3)), constant_values=np.nan)
        known = np.isfinite(placed.sum(axis=1))
        pose = detection.known_samples(stamp_ns, padded, known, where + data.pose.feature, notes)
    with naming(f"episode {index}"):
        found = detection.find_presses(force, data.presses)
        rows = np.flatnonzero(detection.needed(stamp_ns, found))
        wanted = dict(zip(rows.tolist(), stamp_ns[rows].tolist(), strict=True))
        if image in columns:
            title = f"{image} {index}"
            frames = _stored_frames(table.column(image), f"{name}: {image}", title, wanted)
        else:
            numbers = float(info["fps"]) * (time_s + episode[f"videos/{image}/from_timestamp"])
            stamps = {round(numbers[row]): stamp for row, stamp in wanted.items()}
            frames = _video_frames(source, image, episode, stamps)
        notes += [f"Episode {index}: {note}" for note in detection.drift_note(found)]
        presses = detection.cut(found, force, frames, pose)
    return [replace(press, name=f"episode {index}, {press.name}") for press in presses]


def _numbers(
    table: pyarrow.Table, name: str, column: str, first: int = 0, counts: Sequence[int] = (1,)
) -> FloatArray:
    """Return numbers of a column from the first that is wanted on, shape [n, k].

    Args:
        counts: How many are taken: the most of these that there are, and one only where no more
            are.
    """
    cells = table.column(column).to_pylist()
    with whole(f"{name}: {column}", "column of numbers", remedy="name a feature of numbers"):
        values = np.array(cells, dtype=np.float64).reshape(len(cells), -1)
    left = values.shape[1] - first
    fitting = [each for each in counts if each == left or 1 < each <= left]
    if not fitting:
        raise ConfigError(
            f"{column}: has {values.shape[1]} numbers; {' or '.join(map(str, counts))} from number "
            f"{first} on are wanted",
            remedy="correct `first`: which of its numbers is the first that is wanted",
        )
    return values[:, first : first + max(fitting)]


def _wrench(table: pyarrow.Table, name: str, data: LeRobotData) -> FloatArray:
    """Return wrenches: one number is Fz, three are forces, six are forces and moments."""
    newton = unit_factor(data.force.unit, Dimension.FORCE, field="data.force.unit")
    turn = unit_factor(data.moment_unit, Dimension.TORQUE, field="data.moment_unit")
    felt = _numbers(table, name, data.force.feature, data.force.first, (1, 3, 6))
    wrench = np.full((len(felt), 6), np.nan)
    wrench[:, slice(2, 3) if felt.shape[1] == 1 else slice(felt.shape[1])] = felt
    return np.asarray(wrench * np.repeat([newton, turn], 3))


def _stored_frames(
    column: pyarrow.ChunkedArray, where: str, title: str, wanted: Mapping[int, int]
) -> list[detection.Frame]:
    """Return images that stand in cells, by row and stamp [ns]."""
    frames = []
    for row, stamp_ns in wanted.items():
        cell = column[row].as_py()
        data = cell.get("bytes") if isinstance(cell, dict) else None
        if not isinstance(data, bytes) or not 0 < len(data) <= IMAGE_BYTES:
            raise RecordError(
                f"{where}, row {row}: holds no image's bytes",
                remedy="images have to lie within the file; paths to others are not followed",
            )
        read = partial(bytes, data)
        frames.append(detection.Frame(stamp_ns=stamp_ns, name=f"{title}/{row}", read=read))
    return frames


def _video_frames(
    source: Source, key: str, episode: Mapping[str, Any], stamps: Mapping[int, int]
) -> list[detection.Frame]:
    """Return frames of an episode's video, by number and stamp [ns]."""
    name = VIDEOS.format(video_key=key, **{n: int(episode[f"videos/{key}/{n}"]) for n in PLACE})
    path = source.path(name, field="its video", most_bytes=LARGE_BYTES)
    found = png_frames(path, name, stamps)
    if len(found) < len(stamps):
        raise RecordError(
            f"{name}: {len(found)} of the {len(stamps)} frames that are wanted can be read, up to "
            f"frame {max(stamps)}",
            remedy="the video was cut off, or its codec is not read here: convert it with "
            "`ffmpeg -c:v ffv1`, keeping its name, or to H.264",
        )
    return found
