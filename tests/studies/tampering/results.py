"""Ways to tamper with what stands beside the recordings: results, journal, description, replay."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from tacauchy_rig.core.rgb import decode_rgb, encode_png
from tests.studies.tampering.case import (
    OTHER,
    TORN,
    VICTIM,
    TamperCase,
    byte_cases,
    cases_of,
    json_cases,
)
from tests.studies.tampering.copy import Json, RunCopy, exchange

_MOVED_NS = 200_000_000
_DEEPER_M = 1e-4
_FELT_N = 3.0
"""Beyond the noise of the estimate of any arm."""
_HALVED = ("force_measured_n", "force_deviation_n", "force_rate_n_s", "force_drift_n")


def result_cases() -> Iterator[TamperCase]:
    """Yield every case of a result."""
    yield from json_cases(
        "result",
        lambda copy: copy.result(VICTIM),
        {
            "forces halved": lambda r: {field: 0.5 * r[field] for field in _HALVED},
            "outcome of a failed attempt made passed": _forgiven,
            "0.1 mm deeper": lambda r: {"depth_measured_m": r["depth_measured_m"] + _DEEPER_M},
            "contact 0.1 mm higher": lambda r: {"contact_z_m": r["contact_z_m"] + _DEEPER_M},
            "dwell 0.2 s earlier": lambda r: {
                field: r[field] - _MOVED_NS for field in ("dwell_start_ns", "dwell_end_ns")
            },
            "another target": lambda r: {"force_target_n": r["force_target_n"] + 0.5},
            "another zero": lambda r: {"tare_before": _other_mean(r["tare_before"])},
            "drift made none": lambda _: {"force_drift_n": 0.0},
            "the arm's own force 3 N larger": lambda r: {
                "arm_force_n": (r["arm_force_n"] or 0.0) + _FELT_N
            },
            "of another attempt": lambda r: {"attempt": r["attempt"] + 1},
            "force made infinite": lambda _: {"force_measured_n": "Infinity"},
            "dwell ended before it started": lambda r: {
                "dwell_start_ns": r["dwell_end_ns"],
                "dwell_end_ns": r["dwell_start_ns"],
            },
        },
    )
    yield from cases_of(
        "result",
        {
            "exchanged with another trial's": lambda copy: exchange(
                copy.result(VICTIM), copy.result(OTHER)
            )
        },
    )
    cut = {"cut in half": lambda content: content[: len(content) // 2]}
    yield from byte_cases("result", lambda copy: copy.result(VICTIM), cut)
    yield from cases_of("result", {"deleted": lambda copy: copy.result(VICTIM).unlink()})


def _rig_edited(copy: RunCopy) -> None:
    path = copy.paths.rig_toml
    path.write_bytes(path.read_bytes() + b"\n# edited\n")


def journal_cases() -> Iterator[TamperCase]:
    """Yield every case of the journal, the description, the configuration and the truth."""
    yield from cases_of(
        "journal",
        {
            "a line deleted": lambda lines: _where(lines, lambda _, two: [two]),
            "a line twice": lambda lines: _where(lines, lambda one, two: [one, one, two]),
            "two lines exchanged": lambda lines: _where(lines, lambda one, two: [two, one]),
            "force at an attempt's end edited": _edited_end,
            "an attempt's lines deleted": lambda n: [e for e in n if e["trial"] != VICTIM],
            "cut short by its last lines": lambda lines: lines[: 2 * len(lines) // 3],
        },
        lambda copy, change: copy.change_journal(change),
    )
    garbled = {"a line made unreadable": _garbled_line}
    yield from byte_cases("journal", lambda copy: copy.paths.journal, garbled)
    deleted = {"deleted": lambda copy: copy.paths.journal.unlink()}
    yield from cases_of("journal", deleted, cares=TORN)
    yield from json_cases(
        "run.json",
        lambda copy: copy.paths.run_json,
        {
            "sign of the cell flipped": _flipped_sign,
            "emulated devices made real": lambda _: {"simulated": False},
            "a device's serial number edited": _other_device,
        },
    )
    edited = {"edited": _rig_edited}
    yield from cases_of("rig.toml", edited)
    softer = {"a softer gel": lambda truth: {"young_pa": 0.5 * truth["young_pa"]}}
    yield from json_cases("truth.json", lambda copy: copy.paths.truth, softer)
    torn = {"cut in half": lambda content: content[: len(content) // 2]}
    yield from byte_cases("truth.json", lambda copy: copy.paths.truth, torn)
    yield from cases_of(
        "attempt",
        {
            "its folder deleted": lambda copy: shutil.rmtree(copy.result(VICTIM).parent),
            "its folder doubled as a later one": lambda copy: shutil.copytree(
                copy.result(VICTIM).parent, copy.paths.attempt(VICTIM, copy.attempt(VICTIM) + 1)
            ),
        },
    )


def replay_cases() -> Iterator[TamperCase]:
    """Yield every case of a replay."""
    yield from cases_of(
        "replay",
        {
            "images without contact": _no_contact,
            "a trial's image is another's": lambda copy: shutil.copyfile(
                _image(copy, OTHER), _image(copy, VICTIM)
            ),
        },
    )
    damaged = {"an image damaged": lambda content: content[:100]}
    yield from byte_cases("replay", lambda copy: _image(copy, VICTIM), damaged)
    yield from json_cases(
        "replay",
        lambda copy: copy.replay / "replay.json",
        {
            "simulated force edited": lambda r: _first_trial(r, "force_simulated_n", 0.01),
            "pressed to another force": lambda r: _first_trial(r, "force_measured_n", 0.5),
        },
    )
    cut = {"cut in half": lambda content: content[: len(content) // 2]}
    yield from byte_cases("replay", lambda copy: copy.replay / "replay.json", cut)
    yield from cases_of("replay", {"deleted": lambda copy: shutil.rmtree(copy.replay)})


def _forgiven(result: Json) -> Json:
    """Leave an outcome that its own criteria contradict."""
    first, *others = result["criteria"]
    return {"criteria": [{**first, "passed": False}, *others]}


def _other_mean(tare: Json) -> Json:
    return {**tare, "mean": [value + 0.05 for value in tare["mean"]]}


def _where(lines: list[Json], change: Callable[[Json, Json], list[Json]]) -> list[Json]:
    """Put others in the place of two lines that tell of phases of the attempt."""
    place = _phase(lines)
    return [*lines[:place], *change(lines[place], lines[place + 1]), *lines[place + 2 :]]


def _phase(lines: list[Json]) -> int:
    """Return where the first phase of the attempt stands."""
    return next(
        place
        for place, line in enumerate(lines)
        if line["name"] == "phase" and line["trial"] == VICTIM
    )


def _edited_end(lines: list[Json]) -> list[Json]:
    end = next(line for line in lines if line["name"] == "attempt-end")
    end["detail"]["force_measured_n"] *= 0.5
    return lines


def _garbled_line(content: bytes) -> bytes:
    lines = content.splitlines(keepends=True)
    place = _phase([json.loads(line) for line in lines])
    lines[place] = lines[place][: len(lines[place]) // 2] + b"\n"
    return b"".join(lines)


def _flipped_sign(description: Json) -> Json:
    cell = description["config"]["force_sensor"]
    other = -cell["compression_sign"]
    return {
        "config": {
            **description["config"],
            "force_sensor": {**cell, "compression_sign": other},
        },
        "written": {**description["written"], "force_sensor.compression_sign": other},
    }


def _other_device(description: Json) -> Json:
    name, device = next(iter(description["devices"].items()))
    return {"devices": {**description["devices"], name: {**device, "serial": "another"}}}


def _image(copy: RunCopy, trial: int) -> Path:
    return copy.replay / "trials" / f"{trial:02d}" / "image.png"


def _no_contact(copy: RunCopy) -> None:
    """Put an even image in the place of every simulated one."""
    for path in copy.replay.glob("trials/*/image.png"):
        image = decode_rgb(path.read_bytes())
        if image is not None:
            even = np.broadcast_to(np.median(image, axis=(0, 1)), image.shape)
            path.write_bytes(encode_png(np.ascontiguousarray(even, dtype=np.uint8)))


def _first_trial(replay: Json, field: str, more: float) -> Json:
    first, *others = replay["trials"]
    return {"trials": [{**first, field: first[field] + more}, *others]}
