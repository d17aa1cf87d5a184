"""Plans, engines that give the same shards, and sweeps: whole, repeated, interrupted, changed."""

import json
import os
import signal
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from unittest.mock import patch

import mlcroissant
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rocrate.rocrate import ROCrate

from tacauchy_rig.app.sweep import plan as plan_module
from tacauchy_rig.app.sweep import run_sweep
from tacauchy_rig.app.sweep.engines import Folder, InterruptedSweepError, Processes, Work
from tacauchy_rig.app.sweep.plan import Plan, Row, read_plan, row_hash, rows_of
from tacauchy_rig.app.sweep.shards import Made, Shard, _columns, lists
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.image_codec import decode_rgb
from tacauchy_rig.core.registry import Kind, load
from tests.tacauchy_rig.app.sweep.stand_in import EXPECTED, SHARDS, work

_HEAD = 'design = "{design}"\n{count}\n[press]\nsensor = "gelsight-mini"\n'
_BALL = 'indenter = "sphere:diameter=6mm"\n'


def _rows(
    folder: Path, press: str, *, design: str = "sobol", count: str = "count = 8"
) -> list[Row]:
    file = folder / "plan.toml"
    file.write_text(_HEAD.format(design=design, count=count) + press)
    return list(rows_of(read_plan(file)))


def test_grids_combine_and_lists_go_side_by_side(tmp_path: Path) -> None:
    """Grids combine and lists go side by side."""
    press = _BALL + 'depth = ["0.3 mm", "0.6 mm"]\nx = ["-1 mm", "2 mm"]\n'
    grid = _rows(tmp_path, press, design="grid", count="")
    side = _rows(tmp_path, press, design="list", count="")
    assert [(row.x_m, row.depth_m) for row in grid] == [
        (x, depth) for x in (-1e-3, 2e-3) for depth in (0.3e-3, 0.6e-3)
    ]
    assert [(row.x_m, row.depth_m) for row in side] == [(-1e-3, 0.3e-3), (2e-3, 0.6e-3)]


@pytest.mark.parametrize("design", ["sobol", "latin-hypercube"])
def test_drawn_values_fill_their_range_evenly(tmp_path: Path, design: str) -> None:
    """Drawn values fill their range evenly."""
    press = (
        _BALL + 'depth = { from = "0.2 mm", to = "1 mm" }\nx = { from = "-4 mm", to = "4 mm" }\n'
    )
    rows = _rows(tmp_path, press, design=design)
    for values, low, high in (
        ([row.depth_m for row in rows], 0.2e-3, 1e-3),
        ([row.x_m for row in rows], -4e-3, 4e-3),
    ):
        eighths = np.floor((np.array(values, float) - low) / (high - low) * 8)
        assert sorted(eighths) == list(range(8))


def test_a_longer_sobol_plan_begins_with_the_presses_of_a_shorter_one(tmp_path: Path) -> None:
    """A longer sobol plan begins with the presses of a shorter one."""
    press = _BALL + 'depth = { from = "0.2 mm", to = "1 mm" }\nmaterial = "stated"\n'
    short = _rows(tmp_path, press, count="count = 5")
    long = _rows(tmp_path, press, count="count = 9")
    assert long[:5] == short
    assert np.std([row.material for row in long]) > 0.03  # the file states 11 %


def test_a_hash_follows_inputs_and_settings_but_not_the_size_of_shards(tmp_path: Path) -> None:
    """A hash follows inputs, settings and the sensor of ``optics.like``, but no size of shards."""
    (row,) = _rows(tmp_path, _BALL + 'depth = "0.5 mm"\n', count="count = 1")
    plan = read_plan(tmp_path / "plan.toml").simulation
    name = row_hash(row, plan)
    assert row_hash(row, plan.model_copy(update={"shard": 7})) == name
    assert row_hash(row, plan.model_copy(update={"edge": 2e-3})) != name

    lit, dim = load(Kind.SENSOR, "gelsight-mini"), tmp_path / "dim.toml"
    dim.write_text(lit.read_text("utf-8").replace("[90, 15, 10]", "[80, 9, 9]"))
    own, found = load(Kind.SENSOR, "taxim-gelsight"), set()
    for other in (lit, dim):
        plan_module.sensor_of.cache_clear()
        plan_module._sensor_hash.cache_clear()
        with patch("sim.sensor.sensor.load", side_effect=[own, other]):
            found.add(row_hash(replace(row, sensor="taxim-gelsight"), plan))
    assert len(found) == 2


@pytest.mark.parametrize(
    ("press", "count", "design", "message"),
    [
        ('depth = "0.5 mm"\nx = "14 mm"\n', "count = 1", "sobol", "beside the gel"),
        ('depth = "0.5 mm"\ndept = "1 mm"\n', "count = 1", "sobol", "dept: unknown key"),
        ('depth = "0.5 mm"\n', "count = 1000000000", "sobol", "count"),
        ('depth = "0.5 mm"\n', "count = 1\nseed = -1", "sobol", "seed"),
        ('depth = "4.1 mm"\n', "count = 1", "sobol", "in a gel of 4 mm"),
        ('depth = "0.5 mm"\nforce = "1 N"\n', "count = 1", "sobol", "a depth or a force"),
        ('depth = "0.5 mm"\n[dataset]\nname = "../up"\n', "count = 1", "sobol", "dataset.name"),
        ('depth = { from = "0.1 mm", to = "1 mm" }\n', "", "grid", "no steps"),
        ('depth = "0.5 mm"\nfriction = 3\n', "count = 1", "sobol", "friction = 3"),
        ('depth = "0.5"\n', "count = 1", "sobol", "has no unit"),
    ],
)
def test_what_cannot_be_is_refused(
    tmp_path: Path, press: str, count: str, design: str, message: str
) -> None:
    """What cannot be is refused."""
    with pytest.raises(ConfigError, match=message) as refused:
        _rows(tmp_path, _BALL + press, design=design, count=count)
    assert refused.value.remedy


def test_a_grid_of_a_billion_presses_is_refused_before_it_is_made(tmp_path: Path) -> None:
    """A grid of a billion presses is refused before it is made."""
    steps = "".join(
        f'{name} = {{ from = "0.1 mm", to = "0.9 mm", steps = 1000 }}\n'
        for name in ("depth", "x", "y")
    )
    with pytest.raises(ConfigError, match="1,000,000,000 presses"):
        _rows(tmp_path, _BALL + steps, design="grid", count="")


def test_the_example_is_a_plan(tmp_path: Path) -> None:
    """The example is a plan."""
    text = resources.files("tacauchy_rig.app.sweep").joinpath("example.toml").read_text()
    (tmp_path / "plan.toml").write_text(text)
    rows = rows_of(read_plan(tmp_path / "plan.toml"))
    assert len(rows) == 500
    assert {row.object.partition(":")[0] for row in rows} == {"sphere", "cylinder"}


def _folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path / "claims", lambda name: (tmp_path / name).exists())


def _write(tmp_path: Path, made: Iterator[tuple[Shard, Made]]) -> int:
    count = 0
    for shard, (content, *_) in made:
        (tmp_path / shard.name).write_bytes(content)
        count += 1
    return count


@pytest.mark.parametrize("devices", [["cpu"], ["cpu", "cpu"]])
def test_processes_compute_every_shard_once(devices: list[str]) -> None:
    """Processes compute every shard once."""
    made = list(Processes(devices)(work, SHARDS))
    assert len(made) == len(SHARDS)
    assert {shard.name: content for shard, content in made} == EXPECTED


def test_tasks_of_a_folder_leave_what_others_claimed_or_finished(tmp_path: Path) -> None:
    """Tasks of a folder leave what others claimed or finished."""
    first, second = _folder(tmp_path)(work, SHARDS), _folder(tmp_path)
    one, (content, *_) = next(first)
    assert _write(tmp_path, second(work, SHARDS)) == len(SHARDS) - 1
    (tmp_path / one.name).write_bytes(content)
    assert _write(tmp_path, first) == 0
    assert not list((tmp_path / "claims").iterdir())


def test_a_claim_of_a_dead_task_is_taken_over(tmp_path: Path) -> None:
    """A claim of a dead task is taken over."""
    claim = tmp_path / "claims" / SHARDS[0].name
    claim.parent.mkdir()
    claim.touch()
    assert _write(tmp_path, _folder(tmp_path)(work, SHARDS)) == len(SHARDS) - 1
    old = time.time() - 100.0
    claim.touch()
    os.utime(claim, (old, old))
    assert _write(tmp_path, _folder(tmp_path)(work, SHARDS)) == 1


def test_a_task_finishes_its_shard_when_its_end_is_announced(tmp_path: Path) -> None:
    """A task finishes its shard when its end is announced."""
    made = _folder(tmp_path)(work, SHARDS)
    shard, (content, *_) = next(made)
    (tmp_path / shard.name).write_bytes(content)
    os.kill(os.getpid(), signal.SIGUSR1)
    with pytest.raises(InterruptedSweepError):
        next(made)
    assert _write(tmp_path, _folder(tmp_path)(work, SHARDS)) == len(SHARDS) - 1


_PLAN = """
design = "sobol"
count = 5
[press]
sensor = "gelsight-mini"
indenter = ["sphere:diameter=6mm", "cylinder:diameter=5mm,fillet=0.5mm"]
x = { from = "-4 mm", to = "4 mm" }
depth = { from = "0.3 mm", to = "0.8 mm" }
[simulation]
edge = "5 mm"
samples = 1
shard = 2
"""


class KilledError(Exception):
    """Stands for the end of a process."""


class Counting:
    """An engine that counts presses, and ends after some shards."""

    def __init__(self, ends_after: int = 99) -> None:
        self.ends_after, self.pressed = ends_after, 0

    def __call__(self, work: Work, shards: Sequence[Shard]) -> Iterator[tuple[Shard, Made]]:
        """Press in this process."""
        for number, shard in enumerate(shards):
            if number == self.ends_after:
                raise KilledError
            self.pressed += len(shard.rows)
            yield from Processes(["cpu"])(work, [shard])


def _plan(folder: Path, text: str = _PLAN) -> Plan:
    (folder / "plan.toml").write_text(text)
    return read_plan(folder / "plan.toml")


def _swept(plan: Plan, out: Path, *, ends_after: int = 99) -> int:
    engine = Counting(ends_after)
    swept = run_sweep.sweep(plan, rows_of(plan), out, engine)
    assert swept.is_whole
    assert swept.presses == engine.pressed
    assert set(swept.took_s) == ({"setup", "solve", "render", "write"} if swept.presses else set())
    assert 0.5 * swept.elapsed_s <= sum(swept.took_s.values()) <= swept.elapsed_s
    assert all(1e8 < peak < 1e10 for peak in swept.peaks_bytes)
    return engine.pressed


def _bytes(out: Path) -> dict[str, bytes]:
    return {str(file.relative_to(out)): file.read_bytes() for file in out.rglob("*.parquet")}


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Path]:
    """Return a plan and the folder of its data set."""
    folder = tmp_path_factory.mktemp("swept")
    plan = _plan(folder)
    assert _swept(plan, folder / "out") == 5
    return plan, folder / "out"


def test_a_sweep_again_computes_nothing_and_a_longer_one_what_is_new(
    swept: tuple[Plan, Path], tmp_path: Path
) -> None:
    """A sweep again computes nothing and a longer one what is new."""
    plan, out = swept
    before = _bytes(out)
    assert _swept(plan, out) == 0
    assert _bytes(out) == before
    longer = _plan(tmp_path, _PLAN.replace("count = 5", "count = 6"))
    with patch.object(run_sweep, "make_shard", side_effect=KilledError), pytest.raises(KilledError):
        _swept(longer, out)
    assert {name for name in _bytes(out) if name in before} == set(before)


def test_an_interrupted_sweep_loses_nothing_and_has_the_same_bytes(
    swept: tuple[Plan, Path], tmp_path: Path
) -> None:
    """An interrupted sweep loses nothing and has the same bytes."""
    plan, whole = swept
    with pytest.raises(KilledError):
        _swept(plan, tmp_path, ends_after=1)
    assert _swept(plan, tmp_path) == 3
    assert _bytes(tmp_path) == _bytes(whole)


def test_an_index_leads_to_images_fields_and_the_frame_without_contact(
    swept: tuple[Plan, Path],
) -> None:
    """An index leads to images fields and the frame without contact."""
    plan, out = swept
    index = pq.read_table(out / "index.parquet").to_pylist()
    assert [row["commanded_depth_m"] for row in index] == [row.depth_m for row in rows_of(plan)]
    for row in index:
        shard = pq.read_table(out / row["shard"])
        found = shard.slice(row["offset"], 1).to_pylist()[0]
        assert found["hash"] == row["hash"]
        assert row["valid"]
        assert row["force_z_n"] > 0.1
        assert abs(row["depth_m"] - row["commanded_depth_m"]) < 2e-6
        image, reference = decode_rgb(found["image"]), decode_rgb(found["reference"])
        assert image is not None
        assert reference is not None
        assert image.shape == reference.shape == (240, 320, 3)
        assert np.ptp(image) > 50
        assert np.ptp(reference) == 0
        shape = json.loads(shard.schema.field("pressure_pa").metadata[b"shape"])
        cell_m2 = (8 * 0.0634e-3) ** 2
        carried = np.reshape(found["pressure_pa"], shape).sum() * cell_m2
        # The mesh's own force, without its correction of at most a half, which edges of 5 mm nearly
        # reach, and cells that cut the contact's edge.
        assert 0.8 < carried / row["force_z_n"] < 2.2
        deepest = float(np.nanmax(np.array(found["indentation_mm"], float)))
        assert abs(deepest * 1e-3 - row["depth_m"]) < 0.05e-3


@pytest.mark.parametrize(
    ("found", "area_m2", "force_z_n", "reason"),
    [
        (True, 1e-6, 0.2, ""),
        (True, 1e-6, -6e-3, "F_z is not positive"),
        (True, 0.0, 0.0, "does not touch"),
        (False, np.nan, np.nan, "no equilibrium"),
    ],
)
def test_a_press_that_is_not_valid_says_why(
    swept: tuple[Plan, Path], found: bool, area_m2: float, force_z_n: float, reason: str
) -> None:
    """A gel without adhesion cannot pull: such a press is no valid one."""
    row, image = rows_of(swept[0])[0], np.zeros((2, 2, 3), np.uint8)
    numbers = {"depth_m": 5e-4, "force_error": 0.1, "evaluations": 9, "edge_m": 1e-3}
    arrays = {name: np.array([value]) for name, value in numbers.items()}
    arrays |= {"valid": np.array([found]), "contact_area_m2": np.array([area_m2])}
    arrays |= {"wrench": np.array([[0.0, 0.0, force_z_n, 0.0, 0.0, 0.0]]), "image": image[None]}
    made = _columns(0, (row, "hash"), arrays, image)
    assert made["valid"] == (not reason)
    assert reason in made["reason"]


@pytest.mark.parametrize("markers", [0, 3])
def test_a_sensor_without_markers_has_empty_lists(markers: int, tmp_path: Path) -> None:
    """A DIGIT's rows are read back like a GelSight Mini's."""
    values = np.arange(4 * markers, dtype=np.float32).reshape(2, markers, 2)
    pq.write_table(pa.table({"markers_px": lists(values)}), tmp_path / "shard")
    column = pq.read_table(tmp_path / "shard")["markers_px"]
    found = [row.values.to_numpy(zero_copy_only=False).reshape(markers, 2) for row in column]
    assert np.array_equal(found, values)


def test_splits_share_no_object_and_no_place(swept: tuple[Plan, Path]) -> None:
    """Splits share no object and no place."""
    index = pq.read_table(swept[1] / "index.parquet").to_pylist()
    for split, group in (
        ("split_object", lambda row: row["object"]),
        ("split_place", lambda row: (row["x_m"] // 2e-3, row["y_m"] // 2e-3)),
    ):
        sides = {name: {group(r) for r in index if r[split] == name} for name in ("train", "test")}
        assert sides["train"]
        assert sides["test"]
        assert not sides["train"] & sides["test"]


@pytest.mark.filterwarnings("ignore")
def test_the_datasheet_is_read_by_other_programs(swept: tuple[Plan, Path]) -> None:
    """The datasheet is read by other programs."""
    out = swept[1]
    records = list(mlcroissant.Dataset(jsonld=out / "croissant.json").records("presses"))
    assert len(records) == 5
    assert ROCrate(out).name == "presses"
    assert "presses" in (out / "summary.html").read_text()


def test_a_damaged_shard_is_named(swept: tuple[Plan, Path], tmp_path: Path) -> None:
    """A damaged shard is named."""
    (tmp_path / "shards").mkdir()
    (tmp_path / "shards" / "bad.parquet").write_bytes(b"PAR1 nothing")
    with pytest.raises(RecordError, match=r"bad\.parquet"):
        _swept(swept[0], tmp_path)


def test_a_full_disk_stops_before_the_first_press(swept: tuple[Plan, Path], tmp_path: Path) -> None:
    """A full disk stops before the first press."""
    engine = Counting()
    full = patch.object(run_sweep, "free_bytes", return_value=1000)
    with full, pytest.raises(RecordError, match="0 MB free"):
        run_sweep.sweep(swept[0], rows_of(swept[0]), tmp_path, engine)
    assert engine.pressed == 0
