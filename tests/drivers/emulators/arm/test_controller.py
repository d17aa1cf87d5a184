"""The emulated controller, as the real ur_rtde sees it when nobody hides its traps."""

import math
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest
from rtde_control import RTDEControlInterface
from rtde_io import RTDEIOInterface
from rtde_receive import RTDEReceiveInterface

from drivers.arm.ur5_rtde import DASHBOARD_PORT
from drivers.emulators.arm.coarse_force_estimate import COARSENESS
from drivers.emulators.faults import parse_fault
from drivers.emulators.plant.truth import draw_truth, write_truth
from drivers.emulators.process import DeviceSettings, command_line, post_fault
from drivers.emulators.shared_world import WORLD_FILE, SharedWorld, plant_of
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.run import Pose
from tests.drivers.arm_notes import Client, read_events, read_trace, say
from tests.drivers.conftest import changed, wait_until
from tests.studies.fault_table.observation import arm_after

_MODELS = list(RobotModel)


def _control(host: str, model: str) -> Any:
    flags = RTDEControlInterface.FLAG_UPLOAD_SCRIPT
    if model == RobotModel.CB3:
        flags |= RTDEControlInterface.FLAG_NO_EXT_FT
    return RTDEControlInterface(host, -1.0, flags)


def client_everything(host: str, model: str, _folder: str) -> None:
    """Use all interfaces at once, several receivers included, with every default."""
    full, slow = (
        RTDEReceiveInterface(host),
        RTDEReceiveInterface(host, 10.0, ["timestamp", "actual_TCP_pose"]),
    )
    control, outputs = _control(host, model), RTDEIOInterface(host)
    home = full.getActualTCPPose()
    target = [home[0], home[1], home[2] - 0.005, *home[3:]]
    answers = {
        "program": control.isProgramRunning(),
        "tcp": control.setTcp([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]),
        "payload": control.setPayload(0.7, [0.0, 0.0, 0.05]),
        "zero": control.zeroFtSensor(),
        "blocking_move": control.moveL(target, 0.05, 0.5),
        "outside": control.isPoseWithinSafetyLimits([9.0, 0, 0, 0, 0, 0]),
        "output": outputs.setStandardDigitalOut(1, True),
        "contact": control.moveUntilContact([0.0, 0.0, -0.01, 0.0, 0.0, 0.0]),
    }
    time.sleep(0.15)
    rates = []
    for receiver in (full, slow):
        seen, end_s = set(), time.monotonic() + 0.5
        while time.monotonic() < end_s:
            seen.add(receiver.getTimestamp())
            time.sleep(0.0005)
        rates.append(len(seen) / 0.5)
    say(
        **answers,
        reached_m=abs(full.getActualTCPPose()[2] - target[2]),
        slow_pose_equal=slow.getActualTCPPose() == full.getActualTCPPose(),
        bits=[full.getSafetyStatusBits(), full.getRobotMode(), full.getRuntimeState()],
        robot_status=full.getRobotStatus(),
        payload_kg=full.getPayload(),
        joints=len(full.getActualQ()),
        rates=rates,
    )


def client_conflict(host: str, model: str, _folder: str) -> None:
    """Command a velocity during a move, as a careless program would."""
    control = _control(host, model)
    receiver = RTDEReceiveInterface(host)
    pose = receiver.getActualTCPPose()
    pose[2] -= 0.05
    control.moveL(pose, 0.01, 0.1, True)
    time.sleep(0.1)
    control.speedL([0.0, 0.0, 0.005, 0.0, 0.0, 0.0], 0.1, 0.0)
    time.sleep(0.2)
    say(runtime_state=receiver.getRuntimeState())


def client_force(host: str, model: str, _folder: str) -> None:
    """Read the arm's own estimate of force where it stands, 5 mm higher, and zeroed there."""
    control = _control(host, model)
    receiver = RTDEReceiveInterface(host, -1.0, ["actual_TCP_pose", "actual_TCP_force"])
    pressed = _mean_fz(receiver)
    pose = receiver.getActualTCPPose()
    pose[2] += 0.005
    control.moveL(pose, 0.05, 0.5)
    free = _mean_fz(receiver)
    control.zeroFtSensor()
    time.sleep(0.05)
    say(pressed=pressed, free=free, zeroed=_mean_fz(receiver))


def client_pose(host: str, model: str, _folder: str) -> None:
    """Say that it is there, move sideways for three seconds, and watch the height it reports."""
    control = _control(host, model)
    receiver = RTDEReceiveInterface(host, -1.0, ["actual_TCP_pose"])
    first = receiver.getActualTCPPose()[2]
    control.speedL([0.002, 0.0, 0.0, 0.0, 0.0, 0.0], 0.1, 0.0)
    say(watching=True)
    heights, end_s = set(), time.monotonic() + 3.0
    while time.monotonic() < end_s:
        heights.add(receiver.getActualTCPPose()[2])
        time.sleep(0.002)
    control.speedStop(1.0)
    say(first=first, heights=sorted(heights))


def client_unlock(host: str, model: str, _folder: str) -> None:
    """Wait for a protective stop, then for somebody to unlock it, twice; then move."""
    receiver = RTDEReceiveInterface(host, -1.0, ["safety_status_bits"])
    for wanted in (0b100, 0b001, 0b100, 0b001):
        end_s = time.monotonic() + 20.0
        while not receiver.getSafetyStatusBits() & wanted:
            if time.monotonic() > end_s:
                return
            time.sleep(0.01)
        say(bits=wanted)
    control = _control(host, model)
    pose = RTDEReceiveInterface(host).getActualTCPPose()
    pose[2] += 0.005
    say(moved=control.moveL(pose, 0.05, 0.5))


def _mean_fz(receiver: Any) -> float:
    end_s, values = time.monotonic() + 0.5, []
    while time.monotonic() < end_s:
        values.append(receiver.getActualTCPForce()[2])
        time.sleep(0.002)
    return sum(values) / len(values)


def client_leave_moving(host: str, model: str, _folder: str) -> None:
    """Set a velocity without a watchdog and vanish."""
    control = _control(host, model)
    control.speedL([0.0, 0.0, -0.005, 0.0, 0.0, 0.0], 0.1, 0.0)
    time.sleep(0.1)
    say()


def client_stop_l_then_speed(host: str, model: str, _folder: str) -> None:
    """End a velocity by stopL, which does not end the thread that drives it."""
    control, receiver = _control(host, model), RTDEReceiveInterface(host)
    control.speedL([0.0, 0.0, -0.005, 0.0, 0.0, 0.0], 0.1, 0.0)
    time.sleep(0.2)
    control.stopL(1.0)
    time.sleep(0.3)
    after_stop_l = receiver.getActualTCPSpeed()[2]
    control.speedStop(1.0)
    time.sleep(0.1)
    say(after_stop_l=after_stop_l, after_speed_stop=receiver.getActualTCPSpeed()[2])


def _run(scenario: Callable[..., None], robot: Any) -> dict[str, Any]:
    with Client(scenario, robot) as client:
        answer = client.line()
        client.process.join(60)
        return answer


@pytest.mark.parametrize("model", _MODELS)
def test_every_interface_at_once(emulate_ur: Callable[..., Any], model: RobotModel) -> None:
    """Control, two receivers at their own rates and the outputs interface work together."""
    found = _run(client_everything, emulate_ur(model))
    for name in ("program", "tcp", "payload", "zero", "blocking_move", "output"):
        assert found[name] is True, name
    assert found["contact"] is True, "a CB3 says so too, and does nothing"
    assert found["outside"] is False
    assert found["reached_m"] < 1e-9
    assert found["slow_pose_equal"] is True
    assert found["bits"] == [1, 7, 2]
    assert found["robot_status"] == 3
    assert found["payload_kg"] == 0.7
    assert found["joints"] == 6
    fast, slow = found["rates"]
    assert fast > 2 * slow


def test_it_feels_the_gel(emulate_ur: Callable[..., Any], tmp_path: Path) -> None:
    """With a gel in its world, its own estimate of F_z is higher by the gel's force than above."""
    home = Pose(position=(0.0, -0.4, 0.199), rotation_vector=(0.0, math.pi, 0.0))
    robot = emulate_ur(home=home.position, seed=3)
    config = changed(load_config().config, emulation={"seed": 3})
    gel = plant_of(DeviceSettings(folder=tmp_path, config=config))
    found = _run(client_force, robot)
    expected = gel.relaxed(gel.depth(home))[0]
    assert expected > 2.0
    assert found["pressed"] - found["free"] == pytest.approx(expected, rel=0.1)
    # Its zero is one estimate, with the noise of one.
    noise_n = COARSENESS[robot.model].noise_n
    assert abs(found["zeroed"]) < 5.0 * noise_n < abs(found["free"])


def test_a_wrong_pose_is_not_reported(emulate_ur: Callable[..., Any]) -> None:
    """The true tip sinks while the report stays; at the end the report jumps to the truth."""
    robot = emulate_ur()
    world = SharedWorld(robot.folder / WORLD_FILE)
    wait_until(lambda: world.read().sequence > 0)
    assert world.read().pose.position == (0.3, -0.3, 0.2), "the true pose, before a client came"
    with Client(client_pose, robot) as client:
        assert client.line() == {"watching": True}
        before = world.read().pose.position[2]
        post_fault(robot.folder, parse_fault("robot:wrong-pose=1mm/s+1s"))
        found = client.line()
    after = world.read().pose.position[2]
    assert before - after == pytest.approx(1e-3, abs=2e-4)
    assert found["heights"] == [after, found["first"]], "nothing between the two"
    assert found["first"] == before


@pytest.mark.parametrize("way", ["robot:unlock", "dashboard"])
def test_a_person_unlocks_a_protective_stop(emulate_ur: Callable[..., Any], way: str) -> None:
    """By the control or by the dashboard; the stop can come again, and the arm moves after."""
    robot = emulate_ur(RobotModel.CB3)
    with Client(client_unlock, robot) as client:
        for _ in range(2):
            post_fault(robot.folder, parse_fault("robot:protective-stop"))
            assert client.line() == {"bits": 4}
            if way == "dashboard":
                with socket.create_connection((robot.host, DASHBOARD_PORT), timeout=5) as pendant:
                    pendant.recv(100)
                    pendant.sendall(b"unlock protective stop\n")
                    assert pendant.recv(100) == b"Protective stop releasing\n"
            else:
                post_fault(robot.folder, parse_fault(way))
            assert client.line() == {"bits": 1}
        assert client.line() == {"moved": True}


def test_two_threads_on_one_arm_end_the_program(emulate_ur: Callable[..., Any]) -> None:
    """A velocity during a move is a runtime error of the controller, not a choice."""
    robot = emulate_ur()
    assert _run(client_conflict, robot) == {"runtime_state": 1}
    assert read_events(robot.folder)[-1]["reason"] == "runtime error"


def test_without_a_watchdog_the_arm_goes_on(emulate_ur: Callable[..., Any]) -> None:
    """As on a real arm: the client is gone and nothing stops the motion."""
    robot = emulate_ur()
    _run(client_leave_moving, robot)
    gone_ns = time.monotonic_ns()
    time.sleep(0.5)
    report = arm_after(read_trace(robot.folder), gone_ns, now_ns=time.monotonic_ns())
    assert report.stopped_after_s is None
    assert report.descended_m > 0.0005


def test_stop_l_does_not_end_a_velocity(emulate_ur: Callable[..., Any]) -> None:
    """After stopL the arm drives on; speedStop is what ends speedL."""
    found = _run(client_stop_l_then_speed, emulate_ur())
    assert found["after_stop_l"] == pytest.approx(-0.005)
    assert found["after_speed_stop"] == 0.0


def test_a_taken_address_is_refused(emulate_ur: Callable[..., Any], tmp_path: Path) -> None:
    """A second controller at an address says which, and what to do."""
    robot = emulate_ur()
    write_truth(tmp_path / "second", draw_truth(0))
    second = DeviceSettings(
        folder=tmp_path / "second", config=load_config().config, host=robot.host
    )
    result = subprocess.run(
        command_line("arm.controller", second),
        capture_output=True,
        text=True,
        check=False,
        timeout=30,
    )
    assert result.returncode == 2
    assert f"emulated robot at {robot.host}: Address already in use" in result.stderr
    assert "choose a free one" in result.stderr


def test_ends_with_its_parent(tmp_path: Path) -> None:
    """An emulator whose parent was killed does not stay behind."""
    starter = (
        "import pathlib, os, sys\n"
        "from drivers.emulators.launch import free_loopback_host\n"
        "from drivers.emulators.plant.truth import draw_truth, write_truth\n"
        "from drivers.emulators.process import DeviceSettings, EmulatedProcess\n"
        "from tacauchy_rig.core.config.load import load_config\n"
        "folder = pathlib.Path(sys.argv[1])\n"
        "write_truth(folder, draw_truth(0))\n"
        "config, host = load_config().config, free_loopback_host()\n"
        "settings = DeviceSettings(folder=folder, config=config, host=host)\n"
        "child = EmulatedProcess('robot', 'arm.controller', settings)\n"
        "child.wait_ready()\n"
        "print(child.process.pid, flush=True)\n"
        "os._exit(0)\n"
    )
    started = subprocess.run(
        [sys.executable, "-c", starter, str(tmp_path)],
        stdout=subprocess.PIPE,
        check=True,
        timeout=30,
    )
    process_id = int(started.stdout)
    wait_until(lambda: not _lives(process_id), give_up_s=20.0)


def _lives(process_id: int) -> bool:
    try:  # a zombie that nobody waits for counts as ended
        return psutil.Process(process_id).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
