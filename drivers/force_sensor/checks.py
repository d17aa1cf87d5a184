"""Checks of the force sensor: its port, its adapter's timer, and what it streams."""

from __future__ import annotations

import itertools
import os
import statistics
import time
from pathlib import Path

from drivers.device.interface import StreamHealth
from drivers.force_sensor.interface import ForceTorqueSensor
from tacauchy_rig.core.check_result import CheckResult, failed, judged, passed, skipped
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.registry import Kind, load
from tacauchy_rig.core.run import FZ, ForceSample

_GOOD_TIMER_MS = 1
_RATE_TOLERANCE = 0.02


def force_sensor_checks(
    config: RigConfig, *, measure_s: float, sys_folder: Path
) -> list[CheckResult]:
    """Return the checks of the serial port and of ``measure_s`` [s] of unloaded samples."""
    section = config.force_sensor
    sensor: ForceTorqueSensor = load(Kind.FORCE_SENSOR, section.driver)(config, None)
    try:
        identity = sensor.connect()
        # While the port is open: the driver has asked the adapter for low latency by now.
        timer = latency_timer_check(section.port, sys_folder=sys_folder)
        time.sleep(measure_s)
        samples, health = sensor.drain(), sensor.health()
    except DeviceError as error:
        return [failed("force_sensor.stream", error)]
    finally:
        sensor.close()
    set_up = ", ".join(f"{key} {value}" for key, value in identity.settings.items())
    return [
        passed("force_sensor.stream", f"{identity.model} at {identity.address}: {set_up}"),
        timer,
        rate_check(samples, health, asked_hz=section.rate),
        noise_check(samples, config),
    ]


def latency_timer_check(port: str, *, sys_folder: Path) -> CheckResult:
    """Judge how long the USB adapter holds bytes back before it sends them on."""
    name = "force_sensor.latency_timer"
    adapter = Path(os.path.realpath(port)).name
    path = sys_folder / "bus/usb-serial/devices" / adapter / "latency_timer"
    try:
        timer_ms = int(path.read_text("ascii"))
    except (OSError, ValueError):
        return skipped(name, f"{port} is no USB adapter with such a timer")
    is_good = timer_ms <= _GOOD_TIMER_MS
    late = f"{adapter} holds data back for up to {timer_ms} ms, which bunches the frames"
    return judged(
        name,
        f"{adapter} passes data on after {timer_ms} ms" if is_good else late,
        is_good=is_good,
        value=timer_ms,
        unit="ms",
        remedy=f"echo {_GOOD_TIMER_MS} | sudo tee {path}",
    )


def rate_check(samples: list[ForceSample], health: StreamHealth, *, asked_hz: float) -> CheckResult:
    """Judge rate, losses and bunching."""
    gaps = [b.stamp_ns - a.stamp_ns for a, b in itertools.pairwise(samples)]
    longest_ms = max(gaps, default=0) * 1e-6
    finding = (
        f"{health.rate_hz:.2f} Hz for {asked_hz:g} Hz asked, longest gap {longest_ms:.1f} ms, "
        f"{health.lost_count} lost and {health.corrupt_count} damaged of {health.received_count}"
    )
    wrong = abs(health.rate_hz / asked_hz - 1.0) > _RATE_TOLERANCE
    return judged(
        "force_sensor.rate",
        finding,
        is_good=not (wrong or health.lost_count or health.corrupt_count),
        value=health.rate_hz,
        unit="Hz",
        remedy="check cable and shield, the adapter's latency timer, and the rate set in the box",
    )


def noise_check(samples: list[ForceSample], config: RigConfig) -> CheckResult:
    """Judge zero and noise of Fz; the sensor is taken to be unloaded."""
    name = "force_sensor.noise"
    values = [sample.wrench.force[FZ] for sample in samples]
    if len(values) < 2:
        return skipped(name, f"{len(values)} samples are too few")
    mean, deviation = statistics.fmean(values), statistics.stdev(values)
    finding = f"Fz {mean:+.4f} N with {deviation:.4f} N of noise (standard deviation)"
    gate = config.protocol
    remedy = ""
    if deviation > gate.tare_deviation:
        remedy = f"noise is above protocol.tare_deviation {gate.tare_deviation:g} N: keep the arm "
        remedy += "still, check shield and earth"
    elif abs(mean) > gate.tare_mean:
        remedy = f"zero is beyond protocol.tare_mean {gate.tare_mean:g} N: unload the sensor, or "
        remedy += "zero it in the box (AT+ADJZF)"
    elif deviation == 0.0:
        remedy = "a live sensor has noise: switch the box off and on"
    return judged(name, finding, is_good=not remedy, value=deviation, unit="N", remedy=remedy)
