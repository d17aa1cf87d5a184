"""A sweep's presses in others' formats, and the law of a sensor's pressure."""

import io
import json
import os
import resource
import subprocess
import sys
import tarfile
from dataclasses import astuple
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from rosbags.rosbag2 import Reader

from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.exporting.formats import OF_EPISODES, Format, export
from tacauchy_rig.app.exporting.pressure_law import _law, _overlap
from tacauchy_rig.app.importing.ros_bag import TYPES
from tacauchy_rig.app.sweep import run_sweep
from tacauchy_rig.app.sweep.engines import Processes
from tacauchy_rig.app.sweep.plan import read_plan, rows_of
from tacauchy_rig.app.sweep.shards import WRENCH
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.image_codec import decode_rgb

_PLAN = """
design = "list"
[press]
sensor = "gelsight-mini"
indenter = "sphere:diameter=6mm"
x = ["-2 mm", "3 mm"]
depth = ["0.4 mm", "0.7 mm"]
twist = "5 deg"
[simulation]
edge = "5 mm"
samples = 1
"""


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of two presses."""
    folder = tmp_path_factory.mktemp("swept")
    (folder / "plan.toml").write_text(_PLAN)
    plan = read_plan(folder / "plan.toml")
    assert run_sweep.sweep(plan, rows_of(plan), folder / "out", Processes(["cpu"])).is_whole
    return folder / "out"


def test_a_data_set_keeps_its_numbers_in_hdf5_and_webdataset(swept: Path, tmp_path: Path) -> None:
    """Wrenches, fields and images come back as they were computed."""
    rows = {row["hash"]: row for row in pq.read_table(swept / "index.parquet").to_pylist()}
    export(swept, tmp_path / "h", Format.HDF5)
    export(swept, tmp_path / "w", Format.WEBDATASET)
    with (
        h5py.File(tmp_path / "h" / "presses.hdf5") as file,
        tarfile.open(tmp_path / "w" / "presses-000000.tar") as tar,
    ):
        assert len(file["data"]) == len(rows) == 2
        for demo in file["data"].values():
            row = rows[demo.attrs["hash"]]
            shard = pq.read_table(swept / row["shard"]).slice(row["offset"], 1)
            wrench = [row[name] for name in WRENCH]
            assert demo["obs/wrench"][:].tolist() == [[0.0] * 6, wrench]
            assert demo["obs/state"][1, 2] == -row["depth_m"]
            pressed = decode_rgb(shard["image"][0].as_py())
            assert pressed is not None
            assert np.array_equal(demo["obs/tactile"][1], pressed)
            pressure = np.array(shard["pressure_pa"][0].as_py(), np.float32)
            assert np.array_equal(demo["simulated/pressure_pa"][:].ravel(), pressure)
            names = {name.partition(".")[2]: name for name in tar.getnames() if row["hash"] in name}
            content = {end: tar.extractfile(name) for end, name in names.items()}
            assert content["pressed.png"].read() == shard["image"][0].as_py()
            assert json.load(content["json"])["force_z_n"] == row["force_z_n"]
            assert np.load(io.BytesIO(content["wrench_n_nm.npy"].read())).tolist() == [wrench]


def test_a_data_set_becomes_episodes(swept: Path, tmp_path: Path) -> None:
    """Each press is an episode of two rows."""
    export(swept, tmp_path / "out", Format.LEROBOT)
    (file,) = (tmp_path / "out" / "data").rglob("*.parquet")
    table = pq.read_table(file).to_pydict()
    assert table["episode_index"] == [0, 0, 1, 1]
    forces = pq.read_table(swept / "index.parquet")["force_z_n"].to_pylist()
    found = [each[2] for each in table["observation.wrench"]][1::2]
    assert sorted(found) == pytest.approx(sorted(forces), rel=1e-6)
    assert not (tmp_path / "out" / "import.toml").exists()


def test_a_data_set_keeps_its_numbers_in_zarr(swept: Path, tmp_path: Path) -> None:
    """Rows of all presses follow one another; numbers are float32, images whole."""
    zarr = pytest.importorskip("zarr")
    export(swept, tmp_path / "out", Format.ZARR)
    root = zarr.open_group(str(tmp_path / "out" / "presses.zarr"), mode="r")
    rows = sorted(
        pq.read_table(swept / "index.parquet").to_pylist(), key=lambda r: (r["shard"], r["offset"])
    )
    assert root["meta/episode_ends"][:].tolist() == [2, 4]
    wrench = np.array([[row[name] for name in WRENCH] for row in rows], np.float32)
    assert np.array_equal(root["data/observation.wrench"][1::2], wrench)
    table = pq.read_table(swept / rows[0]["shard"])
    sent = [decode_rgb(table["image"][row["offset"]].as_py()) for row in rows]
    assert np.array_equal(root["data/observation.images.tactile"][1::2], np.stack(sent))


def test_a_data_set_keeps_its_numbers_in_a_bag(swept: Path, tmp_path: Path) -> None:
    """Wrenches, depths and images of every press come back from ROS's messages."""
    export(swept, tmp_path / "out", Format.ROSBAG2)
    read: dict[str, list[Any]] = {}
    with Reader(tmp_path / "out" / "recorded") as reader:
        for connection, _stamp, raw in reader.messages():
            message = TYPES.deserialize_cdr(raw, connection.msgtype)
            read.setdefault(connection.topic, []).append(message)
    rows = sorted(
        pq.read_table(swept / "index.parquet").to_pylist(), key=lambda r: (r["shard"], r["offset"])
    )
    felt = [each.wrench for each in read["/force/wrench"]]
    wrenches = [[*astuple(each.force)[:3], *astuple(each.torque)[:3]] for each in felt]
    zero = [0.0] * 6
    assert sorted(wrenches) == sorted([zero, zero, *([r[n] for n in WRENCH] for r in rows)])
    depths = [each.pose.position.z for each in read["/tip/pose"]]
    assert sorted(depths) == sorted([0.0, 0.0, *(-row["depth_m"] for row in rows)])
    images = {each.data.tobytes() for each in read["/tactile/image"]}
    table = pq.read_table(swept / rows[0]["shard"])
    assert images == {*table["image"].to_pylist(), *table["reference"].to_pylist()}


EXPORT_ALL = """
import sys
from tacauchy_rig.app.cli.app import main

run, out, *forms = sys.argv[1:]
for form in forms:
    sys.argv[1:] = ["export", run, out, "--to", form]
    try:
        main()
    except SystemExit as end:
        print(f"{form}: exit {end.code}", file=sys.stderr, flush=True)
"""


def test_a_full_disk_leaves_nothing_and_names_a_remedy(swept: Path, tmp_path: Path) -> None:
    """A limit of the size of files stands for the disk; every format ends with exit code 2.

    Python would cut the bytecode that it keeps, and find it broken next time.
    """
    told = subprocess.run(
        [sys.executable, "-c", EXPORT_ALL, swept, tmp_path / "out", *OF_EPISODES],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (2_000, 2_000)),
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.returncode == 0, told.stderr
    assert "Traceback" not in told.stderr
    rest = told.stderr
    for form in OF_EPISODES:
        own, ended, rest = rest.partition(f"{form}: exit 2\n")
        assert ended, told.stderr
        assert "no space left to write" in own
    assert rest == ""
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("form", [Format.CSV, Format.VTU, Format.TAXIM, Format.PRESSURE_LAW])
def test_formats_that_take_no_data_set_name_those_that_do(
    swept: Path, form: Format, tmp_path: Path
) -> None:
    """What is refused leaves no folder."""
    with pytest.raises(RecordError, match=f"--to {form} takes no data set") as refused:
        export(swept, tmp_path / "out", form)
    assert "rosbag2" in refused.value.remedy
    assert not list(tmp_path.iterdir())


def test_a_law_of_pressure_is_found_from_forces_that_follow_it() -> None:
    """Coefficient and exponent come back, for balls on the resting gel."""
    pad = load_sensor("gelsight-mini").pad
    overlaps = [_overlap(pad, size, depth) for size in (4e-3, 8e-3) for depth in (3e-4, 9e-4)]
    forces = np.array([2e5 * (depth**0.7).sum() * area for depth, area in overlaps])
    assert _law(overlaps, forces) == pytest.approx((2e5, 0.7), rel=1e-3)
    assert _law(overlaps, forces, exponent=1.0)[1] == 1.0
    # On level gel the overlap of a ball is pi R d^2 / (2 H) for n = 1, in parts of the height.
    depth, area = _overlap(pad, 8e-3, 3e-4)
    assert depth.sum() * area == pytest.approx(np.pi * 4e-3 * 9e-8 / pad.height_m, rel=0.1)
