"""Ways to tamper with a recording: its samples, its images, its order, its bytes."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from tacauchy_rig.core.store.recording.messages import (
    ArmMessage,
    ForceMessage,
    ImageMessage,
    RawMessage,
    Topic,
)
from tests.studies.tampering.case import OTHER, TORN, VICTIM, TamperCase, byte_cases, cases_of
from tests.studies.tampering.copy import Messages, RunCopy, exchange

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
