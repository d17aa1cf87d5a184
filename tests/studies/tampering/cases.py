"""Every case of the tampering table, in its order."""

import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tacauchy_rig.core.image_codec import decode_rgb, encode_png
from tacauchy_rig.core.store.recording.mcap_writer import (
    ArmMessage,
    ForceMessage,
    ImageMessage,
    RawMessage,
    Topic,
)
from tests.studies.tampering.copy import Care, Json, Messages, RunCopy, exchange

VICTIM, OTHER = 1, 2  # trials that are tampered with, and that things are taken from

ALL = tuple(Care)
TORN = (Care.BYTES,)
"""For what destroys a file: it has no right checksums, and nobody who seals leaves it so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TamperCase:
    """A change to a copy of a run."""

    name: str  # which file, and what is done to it
    change: Callable[[RunCopy], object]  # does it; hashes follow as far as the copy's care goes
    cares: tuple[Care, ...] = ALL  # how far it is worth being followed up


def cases_of(
    file: str,
    table: Mapping[str, Any],
    apply: Callable[[RunCopy, Any], object] = lambda copy, change: change(copy),
    *,
    cares: tuple[Care, ...] = ALL,
) -> Iterator[TamperCase]:
    """Yield a case for each row of a table."""
    for what, change in table.items():
        done = partial(_apply, apply, change)
        yield TamperCase(name=f"{file}: {what}", change=done, cares=cares)


def json_cases(
    file: str, path: Callable[[RunCopy], Path], table: Mapping[str, Callable[[Json], Json]]
) -> Iterator[TamperCase]:
    """Yield a case for each row that gives fields of a JSON file another value."""
    return cases_of(file, table, lambda copy, fields: copy.change_json(path(copy), fields))


def byte_cases(
    file: str, path: Callable[[RunCopy], Path], table: Mapping[str, Callable[[bytes], bytes]]
) -> Iterator[TamperCase]:
    """Yield a case for each row that destroys a file."""

    def rewrite(copy: RunCopy, change: Callable[[bytes], bytes]) -> None:
        path(copy).write_bytes(change(path(copy).read_bytes()))

    return cases_of(file, table, rewrite, cares=TORN)


def _apply(apply: Callable[[RunCopy, Any], object], change: Any, copy: RunCopy) -> None:
    apply(copy, change)


_FLIPPED_BYTE = 1000  # every so many bytes one bit: a failing disk
_WALK_M = 1e-3
_SHIFT_NS = 50_000_000  # half of the no-contact window of a short run, five force samples
_ADDED_N = 0.05
_KEPT = 0.86

_KINDS: dict[Topic, Any] = {
    Topic.FORCE: ForceMessage,
    Topic.ARM: ArmMessage,
    Topic.IMAGE: ImageMessage,
}


def recording_cases() -> Iterator[TamperCase]:
    """Yield every case of a recording."""
    yield from cases_of(
        "recording",
        {
            "F_z ten times as large": _each(Topic.FORCE, lambda f: {"fz_n": 10.0 * f.fz_n}),
            "F_z half as large": _each(Topic.FORCE, lambda f: {"fz_n": 0.5 * f.fz_n}),
            "sign of F_z flipped": _each(Topic.FORCE, lambda f: {"fz_n": -f.fz_n}),
            "F_x and F_z exchanged": _each(Topic.FORCE, lambda f: {"fx_n": f.fz_n, "fz_n": f.fx_n}),
            f"{_ADDED_N:g} N added to F_z": _each(
                Topic.FORCE, lambda f: {"fz_n": f.fz_n + _ADDED_N}
            ),
            "forces deleted": _without(Topic.FORCE),
            "every tenth force sample deleted": lambda messages: [
                m for m in messages if m.topic is not Topic.FORCE or m.sequence % 10
            ],
            "every tenth force sample twice": _doubled,
            "forces of the dwell in reverse": _reversed_forces,
            "forces 50 ms later than they came": _late_forces,
            "arm 1 mm off": _each(Topic.ARM, lambda arm: {"z_m": arm.z_m + _WALK_M}),
            "arm frozen at its first pose": _frozen(Topic.ARM, "x_m", "y_m", "z_m"),
            "arm deleted": _without(Topic.ARM),
            "one frozen image": _frozen(Topic.IMAGE, "data"),
            "images deleted": _without(Topic.IMAGE),
            "second half of the images deleted": _half_of_images,
            "events deleted": _without(Topic.EVENT),
            "last 14 % deleted": lambda messages: messages[: round(_KEPT * len(messages))],
        },
        lambda copy, change: copy.change_messages(VICTIM, change),
    )
    yield from cases_of(
        "recording",
        {
            "exchanged with another trial's": lambda copy: exchange(
                copy.recording(VICTIM), copy.recording(OTHER)
            ),
            "another trial's, with this one's metadata": _borrow,
            "metadata of another run": lambda copy: copy.change_messages(
                VICTIM, list, run="20200101-000000-other"
            ),
        },
    )
    yield from byte_cases(
        "recording",
        lambda copy: copy.recording(VICTIM),
        {
            "cut to 86 % of its bytes": lambda content: content[: round(_KEPT * len(content))],
            "torn in the middle": lambda content: content[: len(content) // 2],
            "bits flipped": _flipped,
            "index at its end cut off": lambda content: content[:-100],
            "overwritten with zeros": lambda content: bytes(len(content)),
        },
    )
    deleted = {"deleted": lambda copy: copy.recording(VICTIM).unlink()}
    yield from cases_of("recording", deleted, cares=TORN)


def _without(topic: Topic) -> Callable[[Messages], Messages]:
    return lambda messages: [m for m in messages if m.topic is not topic]


def _each(topic: Topic, fields: Callable[[Any], dict[str, Any]]) -> Callable[[Messages], Messages]:
    """Give fields of every message of a topic another value, made from its content."""

    def changed(message: RawMessage) -> RawMessage:
        if message.topic is not topic:
            return message
        content = _KINDS[topic].FromString(message.data)
        for name, value in fields(content).items():
            setattr(content, name, value)
        return replace(message, data=content.SerializeToString())

    return lambda messages: [changed(message) for message in messages]


def _frozen(topic: Topic, *names: str) -> Callable[[Messages], Messages]:
    """Give fields of every message of a topic the value of the first."""

    def change(messages: Messages) -> Messages:
        first = next(_KINDS[topic].FromString(m.data) for m in messages if m.topic is topic)
        return _each(topic, lambda _: {name: getattr(first, name) for name in names})(messages)

    return change


def _doubled(messages: Messages) -> Messages:
    twice = [m for m in messages if m.topic is Topic.FORCE and m.sequence % 10 == 0]
    return sorted([*messages, *twice], key=lambda m: m.log_time)


def _reversed_forces(messages: Messages) -> Messages:
    """Give the samples of the second half the values of one another, the last first."""
    places = [place for place, m in enumerate(messages) if m.topic is Topic.FORCE]
    half, changed = places[len(places) // 2 :], list(messages)
    for place, other in zip(half, reversed(half), strict=True):
        own, given = (ForceMessage.FromString(messages[at].data) for at in (place, other))
        given.stamp_ns, given.counter = own.stamp_ns, own.counter
        changed[place] = replace(messages[place], data=given.SerializeToString())
    return changed


def _late_forces(messages: Messages) -> Messages:
    moved = _each(Topic.FORCE, lambda f: {"stamp_ns": f.stamp_ns + _SHIFT_NS})(messages)
    late = [
        replace(m, log_time=m.log_time + _SHIFT_NS, publish_time=m.log_time + _SHIFT_NS)
        if m.topic is Topic.FORCE
        else m
        for m in moved
    ]
    return sorted(late, key=lambda m: m.log_time)


def _half_of_images(messages: Messages) -> Messages:
    images = [m for m in messages if m.topic is Topic.IMAGE]
    gone = {id(m) for m in images[len(images) // 2 :]}
    return [m for m in messages if id(m) not in gone]


def _borrow(copy: RunCopy) -> None:
    attempt = copy.attempt(VICTIM)
    shutil.copyfile(copy.recording(OTHER), copy.recording(VICTIM))
    copy.change_messages(VICTIM, list, trial=str(VICTIM), attempt=str(attempt))


def _flipped(content: bytes) -> bytes:
    spoilt = bytearray(content)
    for place in range(_FLIPPED_BYTE, len(spoilt), max(_FLIPPED_BYTE, len(spoilt) // 20)):
        spoilt[place] ^= 1
    return bytes(spoilt)


_MOVED_NS = 200_000_000
_DEEPER_M = 1e-4
_FELT_N = 3.0  # beyond the noise of the estimate of any arm
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
        "config": {**description["config"], "force_sensor": {**cell, "compression_sign": other}},
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


def all_cases() -> tuple[TamperCase, ...]:
    """Return the cases."""
    return (*recording_cases(), *result_cases(), *journal_cases(), *replay_cases())
