"""The sample of a data set in ``docs/``: it is read, and one of its presses comes out again."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tacauchy_rig.app.sweep.plan import read_plan, rows_of
from tacauchy_rig.app.sweep.shards import WRENCH, compute_shard
from tacauchy_rig.core.image_codec import decode_rgb

SAMPLE = Path(__file__).parents[2] / "docs/examples/sample"


def test_the_sample_is_whole() -> None:
    """Fifty presses with images, a licence, and the files of its checksums."""
    presses = SAMPLE / "presses"
    rows = pq.read_table(presses / "index.parquet").to_pylist()
    assert len(rows) == 50
    for row in rows:
        shard = pq.read_table(presses / row["shard"], columns=["hash", "image"])
        assert shard["hash"][row["offset"]].as_py() == row["hash"]
        image = decode_rgb(shard["image"][row["offset"]].as_py())
        assert image is not None
        assert image.shape == (60, 80, 3)
    assert "Apache-2.0" in json.dumps(json.loads((presses / "croissant.json").read_text()))
    for line in (presses / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split("  ")
        assert hashlib.sha256((presses / name).read_bytes()).hexdigest() == digest
    assert sum(file.stat().st_size for file in SAMPLE.rglob("*")) < 3e6


def test_a_press_of_the_sample_comes_out_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its forces within rounding, its fields within the rounding of what keeps them."""
    monkeypatch.chdir(SAMPLE)
    plan = read_plan(Path("plan.toml"))
    rows, index = rows_of(plan), pq.read_table("presses/index.parquet").to_pylist()
    chosen = next(k for k, row in enumerate(rows) if row.indenter.startswith("sphere"))
    found, _took = compute_shard([rows[chosen]], plan.simulation)
    kept = index[chosen]
    assert kept["commanded_depth_m"] == rows[chosen].depth_m
    wrench = np.array([kept[name] for name in WRENCH])
    assert found["wrench"][0] == pytest.approx(wrench, rel=1e-3, abs=1e-3 * wrench[2])
    table = pq.read_table(f"presses/{kept['shard']}", columns=["pressure_pa"])
    pressure = table["pressure_pa"][kept["offset"]].values.to_numpy()
    off = np.abs(found["pressure_pa"][0].ravel() - pressure)
    assert off.max() < 0.01 * pressure.max()
