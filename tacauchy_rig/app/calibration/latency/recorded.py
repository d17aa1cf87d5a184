"""Delays of force and image from a recorded press that swayed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from tacauchy_rig.app.calibration.latency.delay import Delay, even_stamps, find_delay
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.model import RigConfig, SyncMode
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.rgb import decode_rgb
from tacauchy_rig.core.run import FZ, Phase
from tacauchy_rig.core.store.journal import read_journal
from tacauchy_rig.core.store.recording.reading import Recording
from tacauchy_rig.core.store.run_store import RunStore

RELAXATION_S = (0.3, 3.0)
"""Silicone gels creep over decades of time; a second and a tenth of it are told from a delay."""
SETTLING_S = 1.0
"""Left out at the beginning: a motion has to be under way for a gel to remember it evenly."""
EARLY_SHARE = 0.05
"""Of stamps: the control loop reads states up to 5 ms after they came, and a busy host reads
anything late now and then. What came early says when a device sends."""
WIDTH_PX = 80
"""To which a frame is reduced: a contact is seen in it, and noise is averaged away."""
BORDER_SHARE = 0.2
"""Of width and height, on each side: the contact is in the middle, housing or counters beside."""
TRIGGER_FRAMES = 0.25
"""By how much of a frame's interval image and force may differ under a trigger."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Latency:
    """Delays of one press against its arm.

    Attributes:
        force: Of the force sensor's stamps.
        image: Of the camera's stamps.
        sync_mode: What the configuration declares of it.
        trigger_missed: Why a declared trigger is not believed; empty where it is, or none is
            declared.
    """

    force: Delay
    image: Delay
    sync_mode: SyncMode
    trigger_missed: str


def find_latency(store: RunStore) -> Latency:
    """Return the delays that the last press of a run which swayed tells.

    Raises:
        RecordError: No press swayed, or the streams show too little of it.
    """
    trial, attempt, start_ns, end_ns = _swayed(store)
    recording = Recording.open(store.paths.recording(trial, attempt))
    arm, force = recording.arm(), recording.force()
    swayed = slice(*np.searchsorted(arm.stamp_ns, (start_ns, end_ns)))
    depth = (
        even_stamps(arm.stamp_ns[swayed], arm.controller_time_s[swayed], share=EARLY_SHARE),
        -arm.pose[swayed, 2],
    )
    felt = slice(*np.searchsorted(force.stamp_ns, (start_ns, end_ns)))
    force_s = even_stamps(
        force.stamp_ns[felt], force.counter[felt].astype(np.float64), share=EARLY_SHARE
    )
    pressing = store.config.force_sensor.compression_sign * force.wrench[felt, FZ]
    # A state is as old as the controller's cycle at most when it is sent: a uniform distribution.
    doubt_s = 1.0 / store.config.robot.model.rate_hz / math.sqrt(12.0)
    late = find_delay(
        depth, (force_s, pressing), name="force", doubt_s=doubt_s, relaxation_s=RELAXATION_S
    )
    seen = find_delay(depth, _seen(recording, start_ns, end_ns), name="image", doubt_s=doubt_s)
    return Latency(
        force=late,
        image=seen,
        sync_mode=store.config.run.sync_mode,
        trigger_missed=trigger_missed(store.config, late, seen),
    )


def _swayed(store: RunStore) -> tuple[int, int, int, int]:
    """Return trial, attempt, start and end [ns] of the last sway that went to its end."""
    begun: tuple[int, int, int] | None = None
    whole: tuple[int, int, int, int] | None = None
    for event in read_journal(store.paths.journal):
        if event.name != "phase":
            continue
        if event.detail.get("phase") == Phase.SWAY:
            begun = event.trial, event.attempt, event.stamp_ns + round(SETTLING_S * 1e9)
        elif begun is not None:
            if event.detail.get("phase") == Phase.RETRACT:
                whole = *begun, event.stamp_ns
            begun = None
    if whole is None:
        raise RecordError(
            f"{store.paths.root}: no press swayed to its end",
            remedy="`tacauchy-rig calibrate latency rig.toml` makes one that does",
        )
    return whole


def _seen(recording: Recording, start_ns: int, end_ns: int) -> tuple[FloatArray, FloatArray]:
    """Return stamps [s] and how far the motion is seen in the frames, in grey levels.

    The first principal component of the frames is what changes most in them: the contact.
    """
    frames, rows = [], []
    for frame in recording.frames(start_ns, end_ns):
        image = decode_rgb(frame.jpeg)
        if image is None:
            continue
        top, left = (round(BORDER_SHARE * length) for length in image.shape[:2])
        middle = np.ascontiguousarray(image[top:-top, left:-left])
        height = max(1, round(middle.shape[0] * WIDTH_PX / middle.shape[1]))
        small = cv2.resize(middle, (WIDTH_PX, height), interpolation=cv2.INTER_AREA)
        frames.append((frame.stamp_ns, frame.counter))
        rows.append(small.astype(np.float64).ravel())
    if len(rows) < 2:
        return np.zeros(0), np.zeros(0)
    table = np.array(rows)
    table -= table.mean(axis=0)
    u, s, _ = np.linalg.svd(table, full_matrices=False)
    stamps, counters = np.array(frames, dtype=np.int64).T
    return even_stamps(stamps, counters.astype(np.float64), share=EARLY_SHARE), u[:, 0] * s[0]


def trigger_missed(config: RigConfig, force: Delay, image: Delay) -> str:
    """Say why a declared trigger is not believed; empty where it is, or where none is declared."""
    if config.run.sync_mode is not SyncMode.EXTERNAL_TRIGGER:
        return ""
    allowed_s = TRIGGER_FRAMES / config.camera.rate
    apart_s = image.delay_s - force.delay_s
    spread_s = 2.0 * math.hypot(image.uncertainty_s, force.uncertainty_s)
    if abs(apart_s) <= allowed_s + spread_s:
        return ""
    return (
        f"run.sync_mode is external_trigger, but images are stamped {apart_s * 1e3:+.1f} ms after "
        f"the force of the same moment, more than {allowed_s * 1e3:.1f} ms (a quarter of a frame)\n"
        "  -> see the trigger's cable and mode; or state the delays in rig.toml and "
        'sync_mode = "host_clock"'
    )
