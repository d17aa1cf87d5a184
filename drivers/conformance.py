"""Checks that every driver must pass.

A check takes a function that returns an unconnected device, uses the device and closes it. It
raises ``NotConformingError``, an ``AssertionError``, where a rule is broken. In a lab's tests::

    @pytest.mark.parametrize("check", ARM_CHECKS, ids=lambda check: check.__name__)
    def test_franka(check):
        check(lambda: Franka.from_config(config))

The arm is moved by millimetres, upwards first: hang it free, with nothing above it.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from drivers.camera.frame_checks import jpeg_size
from drivers.interfaces import Arm, Camera, ForceTorqueSensor, StreamingDevice
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import ForceSample, ImageFrame, Pose

DeviceT = TypeVar("DeviceT", Arm, ForceTorqueSensor, Camera)
SampleT = TypeVar("SampleT", ForceSample, ImageFrame)

FEED_S = 0.01  # between two turns of the control loop
TRAVEL_M = 0.002
SPEED_M_S = 0.005
ACCELERATION_M_S2 = 0.05
ARRIVED_M = 1e-4  # the repeatability of a CB3
MOVE_LIMIT_S = 5.0
STOP_LIMIT_S = 0.2  # as ``Arm.stop`` says
SETTLED_S = 0.3
UNFED_S = 1.5  # longer than any watchdog that the configuration admits, and the braking
OBSERVED_S = 1.0
NOT_BLOCKING_S = 0.05
RATE_TOLERANCE = 0.2
FRESH_S = 0.5


class NotConformingError(AssertionError):
    """A device broke a rule of its interface."""


def _require(holds: bool, promise: str) -> None:
    if not holds:
        raise NotConformingError(promise)


# The arm.


def arm_says_who_it_is(make: Callable[[], Arm]) -> None:
    """``connect`` returns driver, model and address."""
    with _connected(make()):
        pass  # connecting looks at the identity


def arm_tells_fresh_states(make: Callable[[], Arm]) -> None:
    """States are finite, and both of their stamps move on."""
    with _connected(make()) as arm:
        first = arm.state()
        _feed(arm, 10 * FEED_S)
        last = arm.state()
        numbers = (*last.pose.as_vector(), *last.velocity, *(last.tcp_force or ()))
        _require(all(map(math.isfinite, numbers)), "a state holds only finite numbers")
        _require(last.stamp_ns > first.stamp_ns, "the host's stamp moves on")
        _require(last.controller_time_s > first.controller_time_s, "the controller's time moves on")


def arm_hands_over_each_state_once(make: Callable[[], Arm]) -> None:
    """``drain`` returns the states since the last call, oldest first, none twice."""
    with _connected(make()) as arm:
        arm.drain()
        _feed(arm, 20 * FEED_S)
        times = [sample.controller_time_s for sample in arm.drain()]
        _require(len(times) > 1, "drain returns the states that came")
        _require(times == sorted(set(times)), "drain returns oldest first, and none twice")


def arm_admits_where_it_is(make: Callable[[], Arm]) -> None:
    """``is_pose_allowed`` admits the pose that the arm has."""
    with _connected(make()) as arm:
        _require(arm.is_pose_allowed(arm.state().pose), "the arm's own pose is allowed")


def arm_moves_straight_to_its_target(make: Callable[[], Arm]) -> None:
    """``start_move`` returns at once, and ``is_moving`` tells until the arm is there."""
    with _connected(make()) as arm:
        start = arm.state().pose
        for target in (start.shifted(z=TRAVEL_M), start):
            begun_s = time.monotonic()
            arm.start_move(target, speed=SPEED_M_S, acceleration=ACCELERATION_M_S2)
            _require(
                time.monotonic() - begun_s < TRAVEL_M / SPEED_M_S, "start_move returns at once"
            )
            _require(arm.is_moving(), "is_moving tells that a move has begun")
            while arm.is_moving():
                _require(time.monotonic() - begun_s < MOVE_LIMIT_S, "a move ends")
                _feed(arm, FEED_S)
            _feed(arm, SETTLED_S)
            _require(_distance(arm.state().pose, target) < ARRIVED_M, "a move ends at its target")


def arm_holds_a_velocity_until_stopped(make: Callable[[], Arm]) -> None:
    """``set_velocity`` holds while the arm is fed; ``stop`` ends it within 0.2 s."""
    with _connected(make()) as arm:
        start = arm.state().pose
        arm.set_velocity((0.0, 0.0, SPEED_M_S, 0.0, 0.0, 0.0), acceleration=ACCELERATION_M_S2)
        _feed(arm, 2 * SETTLED_S)
        _require(arm.state().velocity[2] > 0.5 * SPEED_M_S, "a velocity holds until it is changed")
        begun_s = time.monotonic()
        arm.stop()
        _require(time.monotonic() - begun_s < STOP_LIMIT_S, "stop returns within 0.2 s")
        _feed(arm, SETTLED_S)
        halted = arm.state()
        _require(math.hypot(*halted.velocity) < 0.01 * SPEED_M_S, "the arm rests after stop")
        _require(halted.pose.position[2] > start.position[2], "the arm went where it was sent")
        arm.stop()


def arm_stops_when_it_is_not_fed(make: Callable[[], Arm]) -> None:
    """Without ``kick_watchdog`` the arm stops by itself: a program that died moves nothing."""
    with _connected(make()) as arm:
        start = arm.state().pose
        arm.set_velocity((0.0, 0.0, SPEED_M_S, 0.0, 0.0, 0.0), acceleration=ACCELERATION_M_S2)
        time.sleep(UNFED_S)
        try:
            stopped = arm.state()
        except DeviceError:
            return
        _require(math.hypot(*stopped.velocity) < 0.01 * SPEED_M_S, "an arm that is not fed stops")
        _require(
            _distance(stopped.pose, start) < SPEED_M_S * UNFED_S, "an arm that is not fed stops"
        )


def arm_locks_in_a_protective_stop(make: Callable[[], Arm]) -> None:
    """After ``protective_stop`` every state is an error, until a person has unlocked the arm."""
    with _connected(make()) as arm:
        arm.protective_stop()
        time.sleep(SETTLED_S)
        try:
            arm.state()
        except DeviceError:
            return
        raise NotConformingError("state raises DeviceError after a protective stop")


ARM_CHECKS: tuple[Callable[[Callable[[], Arm]], None], ...] = (
    arm_says_who_it_is,
    arm_tells_fresh_states,
    arm_hands_over_each_state_once,
    arm_admits_where_it_is,
    arm_moves_straight_to_its_target,
    arm_holds_a_velocity_until_stopped,
    arm_stops_when_it_is_not_fed,
)
"""After the last of them a controller may want a person, so they are run in this order."""

LOCKING_ARM_CHECKS: tuple[Callable[[Callable[[], Arm]], None], ...] = (
    arm_locks_in_a_protective_stop,
)
"""After these a person has to unlock the arm."""


# Force sensor and camera.


def force_sensor_streams(make: Callable[[], ForceTorqueSensor], *, rate_hz: float) -> None:
    """The stream keeps the rules, and every wrench is finite."""
    with _connected(make()) as sensor:
        samples = _stream(sensor, rate_hz)
        numbers = [value for s in samples for value in s.wrench]
        _require(all(map(math.isfinite, numbers)), "a wrench holds only finite numbers")


def camera_streams(make: Callable[[], Camera], *, rate_hz: float) -> None:
    """The stream keeps the rules, and every frame is a whole JPEG of its stated size."""
    with _connected(make()) as camera:
        frames = _stream(camera, rate_hz)
        whole = all(jpeg_size(frame.jpeg) == (frame.width, frame.height) for frame in frames)
        _require(whole, "a frame is a whole JPEG of the size it says")


def _stream(device: StreamingDevice[SampleT], rate_hz: float) -> list[SampleT]:
    """Watch a connected stream for a second; return its samples."""
    _require(bool(device.drain()), "connect returns once the first sample is there")
    time.sleep(OBSERVED_S)
    samples = device.drain()
    health = device.health()
    begun_s = time.monotonic()
    more = device.drain()
    _require(time.monotonic() - begun_s < NOT_BLOCKING_S, "drain never blocks")
    seen = {sample.counter for sample in samples}
    _require(seen.isdisjoint(sample.counter for sample in more), "drain returns nothing twice")
    wanted = rate_hz * OBSERVED_S
    _require(
        abs(len(samples) - wanted) < max(RATE_TOLERANCE * wanted, 2.0),
        f"the stream keeps its rate: {len(samples)} samples in {OBSERVED_S:g} s at {rate_hz:g} Hz",
    )
    _require(abs(health.rate_hz / rate_hz - 1.0) < RATE_TOLERANCE, "health tells the rate")
    _require(health.received_count >= len(samples), "health counts what arrived")
    _require(0.0 <= health.age_s < FRESH_S, "samples are stamped by time.monotonic_ns()")
    _require(health.repeat_count < 0.5 * wanted, "samples of other values have other fingerprints")
    counters = [sample.counter for sample in samples]
    stamps = [sample.stamp_ns for sample in samples]
    _require(counters == sorted(set(counters)), "counters rise, and no sample comes twice")
    _require(stamps == sorted(stamps), "samples come oldest first")
    return samples


# Both.


@contextmanager
def _connected(device: DeviceT) -> Iterator[DeviceT]:
    """Connect a device; close it twice, which every device must bear."""
    try:
        identity = device.connect()
        named = identity.driver and identity.model and identity.address
        _require(bool(named), "connect tells driver, model and address")
        yield device
    finally:
        device.close()
        device.close()


def _feed(arm: Arm, duration_s: float) -> None:
    """Feed and read an arm for a while, as the control loop does."""
    end_s = time.monotonic() + duration_s
    while time.monotonic() < end_s:
        arm.state()
        arm.kick_watchdog()
        time.sleep(FEED_S)


def _distance(one: Pose, other: Pose) -> float:
    return math.dist(one.position, other.position)
