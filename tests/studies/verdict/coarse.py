"""Runs whose images are small, and replays that show just what was recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tacauchy_rig.core.registry import Kind, load
from tests.studies.verdict.bench import Bench


def seen_coarsely(folder: Path) -> Path:
    """Write the file of a sensor whose images are as small as the mock camera's after the crop."""
    text: str = load(Kind.SENSOR, "gelsight-mini").read_text("utf-8")
    for fine, coarse in (("= 320", "= 40"), ("= 240", "= 30"), ("0.0634 mm", "0.5072 mm")):
        assert fine in text
        text = text.replace(fine, coarse)
    path = folder / "coarse.toml"
    path.write_text(text, encoding="utf-8")
    return path


def with_own_images(bench: Bench) -> Bench:
    """Return a bench whose recordings show just what its true replay does."""
    trials = []
    for trial in bench.recorded.trials:
        image = bench.images[trial.index]
        assert trial.images is not None
        shown = replace(trial.images, real=image, first_half=image, second_half=image)
        trials.append(replace(trial, images=shown))
    return replace(bench, recorded=replace(bench.recorded, trials=tuple(trials)))
