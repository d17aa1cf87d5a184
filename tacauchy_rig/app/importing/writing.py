"""Presses of others as a run folder: recordings, results and hashes as the store writes its own."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from typing import Any

import numpy as np

from tacauchy_rig.app.importing.images import Converter
from tacauchy_rig.app.importing.presses import Press, Recorded
from tacauchy_rig.app.importing.source import Source
from tacauchy_rig.core.errors import RecordError, RigError
from tacauchy_rig.core.run import (
    FZ,
    ArmSample,
    ForceSample,
    ImageFrame,
    Imported,
    ImportedTrial,
    Outcome,
    Pose,
    Tare,
    TrialRecord,
    vector6,
)
from tacauchy_rig.core.store.recording.writing import RecordingWriter
from tacauchy_rig.core.store.run_store import RunStore

PRESSES_MOST = 200
"""Of a run: each image is scored against each simulated one, so 200 make 40,000 scores."""
FRAMES_MOST = 2000
"""Of a press: a minute at 30 Hz."""
CHUNK_BYTES = 4 * 2**20
"""Of a recording that nothing can cut off: it can be made again."""
UNKNOWN_STATE = -1
"""Of an arm that nobody here knows: no state of RTDE's."""


def write_presses(
    store: RunStore, recorded: Recorded, source: Source, converter: Converter, *, kind: str
) -> None:
    """Write presses into a new run folder; what fails leaves none behind.

    Raises:
        RecordError: Something is wrong with the source, its images included, or the disk is full.
    """
    try:
        trials = []
        for index, press in enumerate(recorded.presses[:PRESSES_MOST], start=1):
            _write_press(store, index, press, converter, source)
            trials.append(_trial_entry(index, press))
        converter.check_colours(source.problems)
        source.problems.refuse()
        store.imported.save(
            Imported(
                kind=kind,
                source=source.name,
                has_clock=recorded.has_clock,
                unknown=recorded.unknown,
                notes=(*recorded.notes, *source.notes, *converter.notes),
                trials=tuple(trials),
                files=dict(source.hashes),
                clock=recorded.clock,
            )
        )
    except (RigError, OSError):
        shutil.rmtree(store.paths.root, ignore_errors=True)
        raise


def check_counts(recorded: Recorded) -> None:
    """Refuse no press or too many, and presses with too many frames or without those that count."""
    presses = recorded.presses
    if not 1 <= len(presses) <= PRESSES_MOST:
        raise RecordError(
            f"the source holds {len(presses)} presses; a run has 1 to {PRESSES_MOST}",
            remedy="split it into several folders"
            if presses
            else "check how presses are found: columns, topics, and the force at which one begins",
        )
    for press in presses:
        if len(press.frames) > FRAMES_MOST:
            raise RecordError(
                f"press {press.name}: {len(press.frames)} frames; at most {FRAMES_MOST} are read",
                remedy="leave out frames that show neither the gel at rest nor the press held",
            )
        for what, (start, end) in (("no-contact", press.reference), ("held", press.dwell)):
            inside = any(start <= frame.stamp_ns <= end for frame in press.frames)
            if press.frames and not inside:
                raise RecordError(
                    f"press {press.name}: has no {what} frame",
                    remedy="every press needs an image of the gel without contact and one with it",
                )


def _trial_entry(index: int, press: Press) -> ImportedTrial:
    there = {"force": press.force, "arm": press.pose, "image": press.frames}
    return ImportedTrial(
        index=index,
        name=press.name,
        place_m=press.place_m,
        indenter=press.indenter,
        streams=tuple(name for name, stream in there.items() if stream),
        contact_px=press.contact_px,
        image=press.frames[-1].name if press.frames else "",
    )


def _write_press(
    store: RunStore, index: int, press: Press, converter: Converter, source: Source
) -> None:
    metadata = {
        "run": store.paths.root.name,
        "trial": str(index),
        "attempt": "1",
        "config_hash": store.config_hash,
        "imported": press.name,
    }
    path = store.paths.recording(index, 1)
    path.parent.mkdir(parents=True)
    with RecordingWriter(path, metadata=metadata, chunk_size=CHUNK_BYTES) as writer:
        for samples, message in ((press.force, _force), (press.pose, _arm)):
            if samples is not None:
                rows = zip(samples.stamp_ns.tolist(), samples.value.tolist(), strict=True)
                writer.write(message(number, *row) for number, row in enumerate(rows))
        for image in _images(press, converter, source):
            writer.write([image])
        writer.close()
        sha256 = writer.sha256
    store.save_result(
        TrialRecord(
            index=index,
            attempt=1,
            outcome=Outcome.IMPORTED,
            force_target_n=np.nan,
            reason=f"imported: {press.name}",
            contact_z_m=press.contact_z_m,
            depth_measured_m=press.measured_depth_m,
            dwell_start_ns=press.dwell[0],
            dwell_end_ns=press.dwell[1],
            reference_start_ns=press.reference[0],
            reference_end_ns=press.reference[1],
            recording_sha256=sha256,
            **_forces(press, store.config.force_sensor.compression_sign),
        )
    )


def _force(number: int, stamp_ns: int, wrench: list[float]) -> ForceSample:
    return ForceSample(stamp_ns=stamp_ns, counter=number, wrench=vector6(wrench))


def _arm(_: int, stamp_ns: int, pose: list[float]) -> ArmSample:
    return ArmSample(
        stamp_ns=stamp_ns,
        controller_time_s=np.nan,
        pose=Pose.of(pose),
        velocity=vector6([np.nan] * 6),
        runtime_state=UNKNOWN_STATE,
        safety_bits=UNKNOWN_STATE,
        robot_mode=UNKNOWN_STATE,
    )


def _images(press: Press, converter: Converter, source: Source) -> Iterator[ImageFrame]:
    """Yield the images of a press; those that are damaged or unlike the rest are noted."""
    rest, same, is_compared = None, [], False
    for number, frame in enumerate(press.frames):
        is_rest = press.reference[0] <= frame.stamp_ns <= press.reference[1]
        with source.problems.noting():
            data, (width, height) = converter.convert(frame.read(), name=frame.name, rest=rest)
            if rest is not None and not is_rest and not is_compared:
                is_compared = True
                converter.compare(data, rest)
            rest = rest or (data if is_rest else None)
            same += [frame.name] * (data == rest and not is_rest)
            yield ImageFrame(
                stamp_ns=frame.stamp_ns,
                counter=number,
                device_stamp_s=None,
                width=width,
                height=height,
                jpeg=data,
            )
    if same and len(same) == sum(f.stamp_ns > press.reference[1] for f in press.frames):
        source.problems.add(
            f"press {press.name}: {same[0]} is the image of the gel at rest, byte for byte",
            remedy="name another image at rest, or correct this press's image",
        )


def _forces(press: Press, sign: int) -> dict[str, Any]:
    """Return the mean force over the dwell, its scatter and its zero, as far as they are known."""
    held = press.held
    if held is None or press.force is None:
        return {}
    tare = None
    if press.tare is not None:
        value = press.force.within(press.tare).value
        tare = Tare(
            start_ns=press.tare[0],
            end_ns=press.tare[1],
            mean=vector6(value.mean(axis=0).tolist()),
            deviation=vector6(value.std(axis=0, ddof=min(1, len(value) - 1)).tolist()),
            sample_count=len(value),
        )
    return {
        "tare_before": tare,
        "force_measured_n": sign * float(held[:, FZ].mean()),
        "force_deviation_n": float(held[:, FZ].std(ddof=1)) if len(held) > 1 else None,
    }
