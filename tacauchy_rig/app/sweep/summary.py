"""``summary.html``: what a data set covers, what failed and why, how exact it is."""

from __future__ import annotations

import base64
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment

from tacauchy_rig.app.sweep.files import parquet
from tacauchy_rig.app.sweep.plan import Plan
from tacauchy_rig.core.rgb import decode_rgb, encode_jpeg
from tacauchy_rig.core.store.durable import write_atomically

SHOWN = 50
"""Images on the page."""
_QUALITY = 80
_VARIED: tuple[str, ...] = (
    "commanded_depth_m",
    "commanded_force_n",
    "x_m",
    "y_m",
    "shift_x_m",
    "shift_y_m",
)
_VARIED += ("twist_rad", "tilt_x_rad", "tilt_y_rad", "material", "friction", "light", "noise")
_FOUND = ("force_x_n", "force_y_n", "force_z_n", "contact_radius_m")
_SLOWEST = 10


def write_summary(folder: Path, plan: Plan, table: Any) -> None:
    """Write the page of an index's table."""
    rows = table.to_pylist()
    good = [row for row in rows if row["valid"]]
    errors = np.array([row["force_error"] for row in good] or [np.nan])
    reasons = [row["reason"] for row in rows if not row["valid"]]
    facts = {
        "name": plan.dataset.name,
        "rows": rows,
        "valid": len(good),
        "failures": {reason: reasons.count(reason) for reason in sorted(set(reasons))},
        "ranges": [_range(name, rows) for name in _VARIED]
        + [_range(name, good) for name in _FOUND],
        "objects": _counts(rows, "object"),
        "sensors": _counts(rows, "sensor"),
        "errors": [(f"{part} %", np.percentile(errors, part)) for part in (50, 95, 100)],
        "tolerance": plan.simulation.tolerance,
        "within": float(np.mean(errors <= plan.simulation.tolerance)),
        "slowest": sorted(rows, key=lambda row: -row["evaluations"])[:_SLOWEST],
        "images": _images(folder, rows),
    }
    text = resources.files(__package__).joinpath("summary.html.jinja").read_text("utf-8")
    page = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(text)
    write_atomically(folder / "summary.html", page.render(**facts).encode())


def _range(name: str, rows: list[dict[str, Any]]) -> tuple[str, int, float, float]:
    values = [row[name] for row in rows if row[name] is not None]
    return name, len(set(values)), min(values, default=np.nan), max(values, default=np.nan)


def _counts(rows: list[dict[str, Any]], name: str) -> list[tuple[str, int, int, int]]:
    """Return of each value how many presses it has, how many are valid, and are tests by object."""
    found = []
    for value in sorted({row[name] for row in rows}):
        own = [row for row in rows if row[name] == value]
        tests = sum(row["split_object"] == "test" for row in own)
        found.append((value, len(own), sum(row["valid"] for row in own), tests))
    return found


def _images(folder: Path, rows: list[dict[str, Any]]) -> list[tuple[dict[str, Any], str]]:
    """Return some presses, evenly over the plan, with their images as data addresses."""
    chosen = [rows[k] for k in np.unique(np.linspace(0, len(rows) - 1, SHOWN).astype(int))]
    found = []
    for row in chosen:
        file = parquet().parquet.ParquetFile(folder / row["shard"])
        image = decode_rgb(file.read(columns=["image"])["image"][row["offset"]].as_py())
        assert image is not None  # noqa: S101 - a shard's own
        small = base64.b64encode(encode_jpeg(image, quality=_QUALITY)).decode()
        found.append((row, f"data:image/jpeg;base64,{small}"))
    return found
