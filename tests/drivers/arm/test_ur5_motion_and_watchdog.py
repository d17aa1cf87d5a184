"""The driver with the real ur_rtde against the emulated controller, CB3 and e-Series."""

import itertools
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.arm.ur5_motion_and_watchdog import Ur5
from drivers.emulators.faults import parse_fault
from drivers.emulators.process import post_fault
from drivers.emulators.shared_world import WORLD_FILE, SharedWorld
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.errors import DeviceError, RigError, SafetyError
from tacauchy_rig.core.run import Pose
from tests.drivers.arm_notes import Client, read_events, read_trace, say
from tests.drivers.conftest import changed
from tests.studies.fault_table.observation import ArmOutcome, arm_after

_PRESS_M_S = 0.005
_MODELS = list(RobotModel)
# Laxer than in a run, so that a test machine that is held up for 100 ms fails nothing.
_WATCHDOG_HZ = 3.0
_STALE_S = 0.25
_TRAVEL_LIMIT_M = 3.0 * _PRESS_M_S / _WATCHDOG_HZ


def _arm(host: str, model: str) -> Ur5:
    robot = {
        "host": host,
        "model": RobotModel(model),
        "retract_speed": 0.05,  # the largest of them caps all
        "acceleration": 0.5,
        "tcp_offset": (0.0, 0.0, 0.1),
        "payload": 0.5,
        "watchdog": _WATCHDOG_HZ,
        "connect_timeout": 5.0,
    }
    return Ur5(changed(load_config().config, robot=robot, limits={"stale_robot": _STALE_S}))


def _refusals(arm: Ur5, home: Pose) -> list[str]:
    """Ask for speeds beyond the limit, unknown and backwards; return what is said to each."""
    refusals = []
    for speed in (0.06, math.nan, -0.01):
        try:
            arm.start_move(home, speed=speed, acceleration=0.1)
        except SafetyError as error:
            refusals.append(error.message)
    return refusals


def _feed(arm: Ur5, count: int, *, period_s: float) -> None:
    """Read the state and feed the watchdog as the control loop does."""
    for _ in range(count):
        arm.state()
        arm.kick_watchdog()
        time.sleep(period_s)


def client_normal(host: str, model: str, _folder: str) -> None:
    """Connect, move, press, stop, read, close; say what was seen."""
    arm = _arm(host, model)
    identity = arm.connect()
    home = arm.state().pose
    allowed = [arm.is_pose_allowed(home), arm.is_pose_allowed(home.shifted(x=5.0))]
    target = home.shifted(z=-0.01)
    arm.start_move(target, speed=0.04, acceleration=0.4)
    moved_at_once = arm.is_moving()
    while arm.is_moving():
        _feed(arm, 1, period_s=0.004)
    time.sleep(0.02)  # The last state may be a packet behind the end of the move.
    reached = arm.state().pose
    arm.start_move(home, speed=0.04, acceleration=0.4)
    _feed(arm, 20, period_s=0.004)
    arm.stop()
    time.sleep(0.02)
    halted = arm.state().velocity[2]
    for _ in range(40):
        arm.set_velocity((0.0, 0.0, -_PRESS_M_S, 0.0, 0.0, 0.0), acceleration=0.1)
        time.sleep(0.004)
        pressing = arm.state().velocity[2]
    # Feeding at once after a new velocity must not swallow it.
    arm.set_velocity((0.0, 0.0, 0.001, 0.0, 0.0, 0.0), acceleration=0.4)
    for _ in range(100):
        arm.kick_watchdog()
        time.sleep(0.0005)
    time.sleep(0.02)
    fed = arm.state().velocity[2]
    # A move right after a velocity: the driver ends the one before it starts the other.
    arm.start_move(home, speed=0.04, acceleration=0.4)
    arm.state()
    arm.stop()
    refusals = _refusals(arm, home)
    times = [sample.controller_time_s for sample in arm.drain()]
    drained_twice = len(arm.drain())
    arm.stop()
    arm.close()
    arm.close()
    try:
        arm.state()
    except DeviceError as error:
        after = error.message
    say(
        model=identity.model,
        serial=identity.serial,
        simulated=identity.simulated,
        allowed=allowed,
        moved_at_once=moved_at_once,
        error_m=math.dist(reached.position, target.position),
        halted=halted,
        pressing=pressing,
        fed=fed,
        refusals=refusals,
        times=times,
        drained_twice=drained_twice,
        after=after,
    )


def client_press(host: str, model: str, _folder: str, motion: str = "velocity") -> None:
    """Press down for ever, as ``motion`` says; say so; tell the first error and leave."""
    arm = _arm(host, model)
    arm.connect()
    home = arm.state().pose
    down = (0.0, 0.0, -_PRESS_M_S, 0.0, 0.0, 0.0)
    try:
        if motion == "line":
            arm.start_move(home.shifted(z=-0.15), speed=_PRESS_M_S, acceleration=0.1)
        for turn in itertools.count():
            if motion == "line":
                arm.kick_watchdog()
            elif motion != "unfed" or turn == 0:
                arm.set_velocity(down, acceleration=0.1)
            arm.state()
            if turn == 20:
                say(pressing=True)
                if motion == "protect":
                    arm.protective_stop()
            time.sleep(0.005)
    except RigError as error:
        arm.stop()
        again = ""
        try:
            arm.set_velocity(down, acceleration=0.1)
        except DeviceError as second:
            again = second.message
        say(message=error.message, remedy=error.remedy, again=again)


def client_stalled(host: str, model: str, folder: str) -> None:
    """Move an arm that is stuck, then stop it."""
    arm = _arm(host, model)
    arm.connect()
    home = arm.state().pose
    post_fault(Path(folder), parse_fault("robot:stall"))
    time.sleep(0.1)
    arm.start_move(home.shifted(z=-0.001), speed=0.01, acceleration=0.1)
    for _ in range(60):
        arm.kick_watchdog()
        sample = arm.state()
        time.sleep(0.005)
    moving = arm.is_moving()
    arm.stop()
    say(moving=moving, moved_m=math.dist(sample.pose.position, home.position))


@pytest.mark.parametrize("model", _MODELS)
def test_moves_presses_stops_and_closes(emulate_ur: Callable[..., Any], model: RobotModel) -> None:
    """The whole interface does what it says on both generations."""
    robot = emulate_ur(model)
    with Client(client_normal, robot) as client:
        found = client.line()
    assert found["model"] == f"UR5 {model.value}"
    assert found["serial"].isdigit()
    assert found["simulated"] is True
    assert found["allowed"] == [True, False]
    assert found["moved_at_once"] is True
    assert found["error_m"] < 1e-9
    assert found["halted"] == 0.0
    assert found["pressing"] == pytest.approx(-_PRESS_M_S)
    assert found["fed"] == pytest.approx(0.001)
    assert [message.split(" mm/s")[0] for message in found["refusals"]] == [
        f"robot {robot.host}: speed {speed}" for speed in ("60", "nan", "-10")
    ]
    times = found["times"]
    assert len(times) > 20
    assert times == sorted(set(times))
    assert found["drained_twice"] == 0
    assert "not connected" in found["after"]
    names = [event["name"] for event in read_events(robot.folder)]
    assert names == ["program-started", "program-ended"]
    assert read_events(robot.folder)[-1]["reason"] == "stopped by the client"


@pytest.mark.parametrize(
    ("model", "motion"), [(RobotModel.E_SERIES, "velocity"), (RobotModel.CB3, "line")]
)
def test_arm_stops_when_its_client_is_killed(
    emulate_ur: Callable[..., Any], model: RobotModel, motion: str
) -> None:
    """After SIGKILL of the client the watchdog ends the motion within a fraction of a mm."""
    robot = emulate_ur(model)
    with Client(client_press, robot, motion) as client:
        client.await_pressing()
        client.process.kill()
        killed_ns = time.monotonic_ns()
    _await_event(robot.folder, "program-ended")
    assert read_events(robot.folder)[-1]["reason"] == "watchdog"
    time.sleep(0.2)
    report = _after(robot.folder, killed_ns)
    assert report.speed_before_m_s == pytest.approx(_PRESS_M_S)
    assert report.stopped_after_s is not None
    assert 0.0 < report.descended_m < _TRAVEL_LIMIT_M


def _after(folder: Path, stamp_ns: int) -> ArmOutcome:
    return arm_after(read_trace(folder), stamp_ns, now_ns=time.monotonic_ns())


def _await_event(folder: Path, name: str) -> None:
    end_s = time.monotonic() + 10.0
    while all(event["name"] != name for event in read_events(folder)):
        if time.monotonic() > end_s:
            pytest.fail(f"{name} never happened")
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("model", "fault", "message"),
    [
        (RobotModel.E_SERIES, "protective-stop", "protective stop"),
        (RobotModel.CB3, "emergency-stop", "emergency stop"),
        (RobotModel.E_SERIES, "delay=600ms", "no new data for"),
        (RobotModel.E_SERIES, "clock-jump", "clock jumped by +10.0 s"),
        (RobotModel.E_SERIES, "drop", "the connection broke"),
        (RobotModel.CB3, "freeze", "no new data for"),
        (RobotModel.CB3, "clock-jump=-2s", "clock jumped by -2.0 s"),
    ],
)
def test_a_fault_is_told_and_the_arm_stops(
    emulate_ur: Callable[..., Any], model: RobotModel, fault: str, message: str
) -> None:
    """Each fault while pressing gives its reason, stays, and ends the motion."""
    robot = emulate_ur(model)
    with Client(client_press, robot) as client:
        client.await_pressing()
        before_ns = time.monotonic_ns()
        post_fault(robot.folder, parse_fault(f"robot:{fault}"))
        found = client.line(may_crash=fault == "drop")
    if found:
        assert f"robot {robot.host}: " in found["message"]
        assert message in found["message"]
        assert found["remedy"]
        assert found["again"] == found["message"]
    _await_event(robot.folder, "program-ended")
    time.sleep(0.2)
    report = _after(robot.folder, before_ns)
    assert report.stopped_after_s is not None
    assert report.descended_m < _TRAVEL_LIMIT_M


def test_a_glitch_is_never_bridged_silently(emulate_ur: Callable[..., Any]) -> None:
    """Connections that break for a moment are a loss, although the library would come back."""
    robot = emulate_ur()
    with Client(client_press, robot) as client:
        client.await_pressing()
        post_fault(robot.folder, parse_fault("robot:drop+5ms"))
        found = client.line()
    assert "the connection broke" in found["message"]
    assert found["again"] == found["message"]


@pytest.mark.parametrize(
    ("model", "motion", "message", "remedy"),
    [
        # Reading the state feeds nothing: the watchdog bites, and the message says why.
        (
            RobotModel.CB3,
            "unfed",
            "the program on the controller ended (runtime state stopped)",
            "not fed for 333 ms",
        ),
        (RobotModel.E_SERIES, "protect", "protective stop", "never automatically"),
    ],
)
def test_what_a_client_does_or_forgets_ends_its_program(
    emulate_ur: Callable[..., Any], model: RobotModel, motion: str, message: str, remedy: str
) -> None:
    """An arm that is not fed, and the guard's last means: the state says what happened."""
    with Client(client_press, emulate_ur(model), motion) as client:
        client.await_pressing()
        found = client.line()
    assert message in found["message"]
    assert remedy in found["remedy"]


def test_a_stalled_arm_keeps_moving_on_paper(emulate_ur: Callable[..., Any]) -> None:
    """A move that gets nowhere stays a move, its pose stands, and it can be stopped."""
    robot = emulate_ur()
    with Client(client_stalled, robot) as client:
        assert client.line() == {"moving": True, "moved_m": 0.0}


def test_second_client_is_refused(emulate_ur: Callable[..., Any]) -> None:
    """A second program is told that the robot is taken; the first goes on."""
    robot = emulate_ur()
    with Client(client_press, robot) as client:
        client.await_pressing()
        with pytest.raises(DeviceError, match="another program already controls it"):
            _arm(robot.host, robot.model.value).connect()
        time.sleep(0.2)
        assert client.process.is_alive()
        assert [event["name"] for event in read_events(robot.folder)] == ["program-started"]


def test_a_killed_controller_is_noticed(emulate_ur: Callable[..., Any]) -> None:
    """When the emulated controller dies, the client is told and the world stays readable."""
    robot = emulate_ur()
    with Client(client_press, robot) as client:
        client.await_pressing()
        robot.process.process.kill()
        found = client.line()
    assert "the connection broke" in found["message"]
    state = SharedWorld(robot.folder / WORLD_FILE).read()
    assert state.pose.position[2] < 0.2


def test_calls_before_connecting_say_so() -> None:
    """Without a connection, motion is refused plainly and stopping is harmless."""
    arm = _arm("127.0.0.1", "cb3")
    arm.stop()
    arm.close()
    for call in (arm.state, arm.kick_watchdog, arm.protective_stop):
        with pytest.raises(DeviceError, match=r"robot 127\.0\.0\.1: not connected"):
            call()
    assert not arm.is_moving()
    assert arm.drain() == []
