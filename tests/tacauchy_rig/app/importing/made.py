"""Sources of a few numbers, in the layouts that their formats document."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

HZ = 50
REST_S, HELD_S = 2.0, 1.0
LEROBOT_SPEC = """
kind = "lerobot"
[data]
force = { feature = "observation.wrench", unit = "N" }
pose = { feature = "observation.state", unit = "mm" }
[rig.sensor]
name = "gelsight-mini"
[rig.replay]
indenter = "sphere:diameter=4mm"
"""
RECORDS_SPEC = """
kind = "records"
[data]
records = "feats"
colour_order = "BGR"
no_contact = "rest.npy"
is_tared = true
still = ["dx", "dy", "deg"]
[data.indenters]
sphere_10 = "sphere:diameter=10mm"
cylinder_5 = "cylinder:diameter=5mm,fillet=0.1mm"
[data.columns]
image = "image"
force = { column = "fz", unit = "N" }
depth = { column = "dz", unit = "mm" }
x = { column = "x0", unit = "mm" }
y = { column = "y0", unit = "mm" }
[rig.sensor]
name = "gelsight-mini"
"""
BLUE, RED = 20, 120  # of an image as OpenCV has it: blue first


def record(**changed: Any) -> dict[str, Any]:
    """Return a record as FEATS documents it: place, way, turn, wrench, image and a map."""
    image = np.zeros((48, 64, 3), np.uint8)
    image[...] = (BLUE, 60, RED)
    told = {"x0": 1.5, "y0": -2.0, "z0": 0.0, "dx": 0.0, "dy": 0.0, "dz": 0.4, "deg": 0.0}
    felt = {"fx": 0.0, "fy": 0.0, "fz": 2.5, "mx": 0.0, "my": 0.0, "mz": 0.0}
    maps = {"grid_z": np.zeros((4, 5))}
    return {**told, **felt, **maps, "image": image, **changed}


def make_records(folder: Path) -> Path:
    """Write two straight presses and one that slides, and how to import them."""
    (folder / "feats").mkdir(parents=True)
    np.savez(folder / "feats/1_sphere_10.npz", **record())
    np.savez(folder / "feats/2_cylinder_5.npz", **record(fz=4.0, dz=0.3))
    np.savez(folder / "feats/3_sphere_10.npz", **record(dx=0.2))
    np.save(folder / "rest.npy", np.full((48, 64, 3), 90, np.uint8))
    (folder / "import.toml").write_text(RECORDS_SPEC)
    return folder


def make_lerobot(folder: Path, *, kind: str = "image") -> Path:
    """Write a dataset of two episodes of one press each, 2 N and 3 N, and how to import it."""
    key = "observation.images.tactile"
    data = [_episode(index, newton) for index, newton in enumerate((2.0, 3.0))]
    features: dict[str, Any] = {
        key: {"dtype": kind, "shape": [48, 64, 3], "names": ["height", "width", "channels"]},
        "observation.wrench": {"dtype": "float32", "shape": [6], "names": None},
        "observation.state": {"dtype": "float32", "shape": [3], "names": ["x", "y", "z"]},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    }
    info = {
        "codebase_version": "v3.0",
        "total_episodes": 2,
        "fps": HZ,
        "chunks_size": 1000,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
        "features": features,
    }
    rows = [row for episode in data for row in episode]
    if kind == "image":
        for row in rows:
            row[key] = {"bytes": bytes(cv2.imencode(".png", _image(row))[1]), "path": None}
    else:
        _video(folder / f"videos/{key}/chunk-000/file-000.mp4", rows)
    episodes = [
        {
            "episode_index": index,
            "length": len(episode),
            "data/chunk_index": 0,
            "data/file_index": 0,
            f"videos/{key}/chunk_index": 0,
            f"videos/{key}/file_index": 0,
            f"videos/{key}/from_timestamp": index * len(data[0]) / HZ,
        }
        for index, episode in enumerate(data)
    ]
    _parquet(folder / "data/chunk-000/file-000.parquet", rows)
    _parquet(folder / "meta/episodes/chunk-000/file-000.parquet", episodes)
    (folder / "meta/info.json").write_text(json.dumps(info))
    (folder / "import.toml").write_text(LEROBOT_SPEC)
    return folder


def _episode(index: int, newton: float) -> list[dict[str, Any]]:
    """Return rows: rest, a press of so many newtons, rest; 0.1 mm a newton deep."""
    rest, held = round(REST_S * HZ), round(HELD_S * HZ)
    force = newton * np.concatenate([np.zeros(rest), np.ones(held), np.zeros(held)])
    return [
        {
            "timestamp": k / HZ,
            "frame_index": k,
            "episode_index": index,
            "observation.wrench": [0.0, 0.0, float(f), 0.0, 0.0, 0.0],
            "observation.state": [0.0, 0.0, -0.1 * float(f)],
        }
        for k, f in enumerate(force)
    ]


def _image(row: dict[str, Any]) -> np.ndarray:
    level = 90 + round(20 * row["observation.wrench"][2])
    return np.full((48, 64, 3), level, np.uint8)


def _video(path: Path, rows: list[dict[str, Any]]) -> None:
    path.parent.mkdir(parents=True)
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), HZ, (64, 48))
    assert video.isOpened()
    for row in rows:
        video.write(_image(row))
    video.release()


def _parquet(path: Path, rows: list[dict[str, Any]]) -> None:
    path.parent.mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist(rows), path)
