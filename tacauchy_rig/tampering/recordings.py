"""Ways to tamper with a recording: its samples, its images, its order, its bytes."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from tacauchy_rig.store.recording.messages import (
    ArmMessage,
    ForceMessage,
    ImageMessage,
    RawMessage,
    Topic,
)
from tacauchy_rig.tampering.case import TORN, TamperCase
from tacauchy_rig.tampering.copy import Messages, RunCopy

VICTIM, OTHER = 1, 2
"""Trials that are tampered with, and that things are taken from."""

_FLIPPED_BYTE = 1000  # every so many bytes one bit: a failing disk
_WALK_M = 1e-3
_SHIFT_NS = 50_000_000  # half of the no-contact window of a short run, five force samples
_ADDED_N = 0.05


def recording_cases() -> Iterator[TamperCase]:
    """Yield every case of a recording."""
    yield _samples("F_z ten times as large", lambda f: _set(f, fz_n=10.0 * f.fz_n))
    yield _samples("F_z half as large", lambda f: _set(f, fz_n=0.5 * f.fz_n))
    yield _samples("sign of F_z flipped", lambda f: _set(f, fz_n=-f.fz_n))
    yield _samples("F_x and F_z exchanged", lambda f: _set(f, fx_n=f.fz_n, fz_n=f.fx_n))
    yield _samples(f"{_ADDED_N:g} N added to F_z", lambda f: _set(f, fz_n=f.fz_n + _ADDED_N))
    yield _messages("forces deleted", lambda m: [x for x in m if x.topic is not Topic.FORCE])
    yield _messages("every tenth force sample deleted", _thinned)
    yield _messages("every tenth force sample twice", _doubled)
    yield _messages("forces of the dwell in reverse", _reversed_forces)
    yield _messages("forces 50 ms later than they came", _late_forces)
    yield _messages("arm 1 mm off", _arm_off)
    yield _messages("arm frozen at its first pose", _arm_frozen)
    yield _messages("arm deleted", lambda m: [x for x in m if x.topic is not Topic.ARM])
    yield _messages("one frozen image", _frozen)
    yield _messages("images deleted", lambda m: [x for x in m if x.topic is not Topic.IMAGE])
    yield _messages("second half of the images deleted", _half_of_images)
    yield _messages("events deleted", lambda m: [x for x in m if x.topic is not Topic.EVENT])
    yield _messages("last 14 % deleted", lambda m: m[: round(0.86 * len(m))])
    yield TamperCase(name="recording: exchanged with another trial's", change=_swap)
    yield TamperCase(name="recording: another trial's, with this one's metadata", change=_borrow)
    yield TamperCase(name="recording: metadata of another run", change=_other_run)
    yield TamperCase(name="recording: cut to 86 % of its bytes", change=_cut, cares=TORN)
    yield TamperCase(name="recording: torn in the middle", change=_torn, cares=TORN)
    yield TamperCase(name="recording: bits flipped", change=_flipped, cares=TORN)
    yield TamperCase(name="recording: index at its end cut off", change=_without_index, cares=TORN)
    yield TamperCase(name="recording: overwritten with zeros", change=_zeroed, cares=TORN)
    yield TamperCase(name="recording: deleted", change=_deleted, cares=TORN)


def _messages(name: str, change: Callable[[Messages], Messages]) -> TamperCase:
    return TamperCase(
        name=f"recording: {name}", change=lambda copy: copy.change_messages(VICTIM, change)
    )


def _samples(name: str, change: Callable[[Any], Any]) -> TamperCase:
    return _messages(name, lambda messages: [_force(m, change) for m in messages])


def _force(message: RawMessage, change: Callable[[Any], Any]) -> RawMessage:
    if message.topic is not Topic.FORCE:
        return message
    changed = change(ForceMessage.FromString(message.data))
    return replace(message, data=changed.SerializeToString())


def _set(sample: Any, **fields: float) -> Any:
    for name, value in fields.items():
        setattr(sample, name, value)
    return sample


def _thinned(messages: Messages) -> Messages:
    return [m for m in messages if m.topic is not Topic.FORCE or m.sequence % 10]


def _doubled(messages: Messages) -> Messages:
    twice = [m for m in messages if m.topic is Topic.FORCE and m.sequence % 10 == 0]
    return sorted([*messages, *twice], key=lambda m: m.log_time)


def _reversed_forces(messages: Messages) -> Messages:
    """Give the samples of the second half the values of one another, the last first."""
    forces = [m for m in messages if m.topic is Topic.FORCE]
    half = forces[len(forces) // 2 :]
    given = {id(m): ForceMessage.FromString(o.data) for m, o in zip(half, half[::-1], strict=True)}

    def exchanged(message: RawMessage) -> RawMessage:
        if id(message) not in given:
            return message
        own = ForceMessage.FromString(message.data)
        other = _set(given[id(message)], stamp_ns=own.stamp_ns, counter=own.counter)
        return replace(message, data=other.SerializeToString())

    return [exchanged(message) for message in messages]


def _late_forces(messages: Messages) -> Messages:
    def later(message: RawMessage) -> RawMessage:
        if message.topic is not Topic.FORCE:
            return message
        moved = _force(message, lambda f: _set(f, stamp_ns=f.stamp_ns + _SHIFT_NS))
        stamp_ns = message.log_time + _SHIFT_NS
        return replace(moved, log_time=stamp_ns, publish_time=stamp_ns)

    return sorted(map(later, messages), key=lambda m: m.log_time)


def _arm(messages: Messages, change: Callable[[Any], Any]) -> Messages:
    return [
        replace(m, data=change(ArmMessage.FromString(m.data)).SerializeToString())
        if m.topic is Topic.ARM
        else m
        for m in messages
    ]


def _arm_off(messages: Messages) -> Messages:
    return _arm(messages, lambda state: _set(state, z_m=state.z_m + _WALK_M))


def _arm_frozen(messages: Messages) -> Messages:
    first = next(ArmMessage.FromString(m.data) for m in messages if m.topic is Topic.ARM)
    place = {name: getattr(first, name) for name in ("x_m", "y_m", "z_m")}
    return _arm(messages, lambda state: _set(state, **place))


def _frozen(messages: Messages) -> Messages:
    first = next(ImageMessage.FromString(m.data) for m in messages if m.topic is Topic.IMAGE)

    def same(message: RawMessage) -> RawMessage:
        if message.topic is not Topic.IMAGE:
            return message
        image = ImageMessage.FromString(message.data)
        image.data = first.data
        return replace(message, data=image.SerializeToString())

    return [same(message) for message in messages]


def _half_of_images(messages: Messages) -> Messages:
    images = [m for m in messages if m.topic is Topic.IMAGE]
    gone = {id(m) for m in images[len(images) // 2 :]}
    return [m for m in messages if id(m) not in gone]


def _swap(copy: RunCopy) -> None:
    first, second = copy.recording(VICTIM), copy.recording(OTHER)
    aside = first.with_name("aside")
    first.rename(aside)
    second.rename(first)
    aside.rename(second)


def _borrow(copy: RunCopy) -> None:
    path, attempt = copy.recording(VICTIM), copy.attempt(VICTIM)
    shutil.copyfile(copy.recording(OTHER), path)
    own = {"trial": str(VICTIM), "attempt": str(attempt)}
    copy.change_messages(VICTIM, list, metadata=lambda m: {**m, **own})


def _other_run(copy: RunCopy) -> None:
    copy.change_messages(VICTIM, list, metadata=lambda m: {**m, "run": "20200101-000000-other"})


def _cut(copy: RunCopy) -> None:
    path = copy.recording(VICTIM)
    content = path.read_bytes()
    path.write_bytes(content[: round(0.86 * len(content))])


def _torn(copy: RunCopy) -> None:
    path = copy.recording(VICTIM)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


def _flipped(copy: RunCopy) -> None:
    path = copy.recording(VICTIM)
    content = bytearray(path.read_bytes())
    for place in range(_FLIPPED_BYTE, len(content), max(_FLIPPED_BYTE, len(content) // 20)):
        content[place] ^= 1
    path.write_bytes(content)


def _without_index(copy: RunCopy) -> None:
    path = copy.recording(VICTIM)
    path.write_bytes(path.read_bytes()[:-100])


def _zeroed(copy: RunCopy) -> None:
    path = copy.recording(VICTIM)
    path.write_bytes(bytes(path.stat().st_size))


def _deleted(copy: RunCopy) -> None:
    copy.recording(VICTIM).unlink()
