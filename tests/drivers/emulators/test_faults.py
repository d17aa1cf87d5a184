"""Telling an emulated device to fail, and what its messages and readings become."""

import math
import random
import socket
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.emulators.camera.frames_and_noise import garbled
from drivers.emulators.faults import (
    FAULTS_OF_DEVICE,
    STOPS,
    Device,
    Fault,
    FaultKind,
    FaultyLine,
    SilentArmFaults,
    SilentImageFaults,
    SilentWrenchFaults,
    parse_fault,
)
from drivers.emulators.process import DeviceSettings, Service, control_path, post_fault
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import ConfigError, DeviceError
from tacauchy_rig.core.run import Vector6

_seconds = st.floats(1e-6, 1e6)


@contextmanager
def _listening(folder: Path, device: Device = Device.ROBOT) -> Iterator[Service]:
    with closing(
        Service(DeviceSettings(folder=folder, config=load_config().config), device)
    ) as service:
        yield service


@pytest.fixture(scope="module", params=list(Device))
def listener(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Path, Service]]:
    """A device that hears what it is told, and its folder."""
    folder = tmp_path_factory.mktemp("devices")
    with _listening(folder, request.param) as service:
        yield folder, service


def test_parses_device_kind_start_and_duration() -> None:
    """The full form and the short form mean what they say."""
    fault = parse_fault("force_sensor:freeze@12s+2s")
    assert fault == Fault(
        device=Device.FORCE_SENSOR, kind=FaultKind.FREEZE, start_s=12.0, duration_s=2.0
    )
    assert parse_fault("robot:stall+500ms").duration_s == 0.5
    assert parse_fault("robot:protective-stop@3s").start_s == 3.0
    assert math.isinf(parse_fault("camera:unplug").duration_s)
    assert parse_fault("force_sensor:scale=0.1@3s").amount == 0.1
    assert parse_fault("robot:wrong-pose=-0.2 mm/s+4s").amount == -0.2e-3
    assert parse_fault("camera:drop").size == 0.3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robot", "is not understood"),
        ("robot:freeze@12", "has no unit"),
        ("lamp:freeze", "device 'lamp' is unknown"),
        ("robot:melt", "kind 'melt' is unknown"),
        ("robot:garble@1s", "a robot cannot garble"),
        ("camera:emergency-stop", "a camera cannot emergency-stop"),
        ("robot:freeze@1s+0s", "impossible"),
        ("robot:freeze@-1s", "impossible"),
        ("robot:freeze=2", "robot:freeze takes no amount"),
        ("force_sensor:drop=120%", "1.2 is not from 0 to 1"),
        ("robot:clock-jump=10", "has no unit"),
        ("camera:freeze", "a camera cannot freeze"),
    ],
)
def test_refuses_with_the_reason(text: str, message: str) -> None:
    """A bad plan is refused, saying why and what would do."""
    with pytest.raises(ConfigError, match=message) as caught:
        parse_fault(text)
    assert caught.value.remedy


@given(
    data=st.data(),
    start_s=st.just(0.0) | _seconds,
    duration_s=st.just(math.inf) | _seconds,
    share=st.floats(0.0, 1.0),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_sent_is_what_arrives(
    listener: tuple[Path, Service],
    data: st.DataObject,
    start_s: float,
    duration_s: float,
    share: float,
) -> None:
    """Any fault of any device survives the socket, and is on from its start for its duration."""
    folder, service = listener
    kind = data.draw(st.sampled_from(sorted(FAULTS_OF_DEVICE[service.device])))
    possible = FAULTS_OF_DEVICE[service.device][kind]
    amount = possible and possible.least + share * (possible.most - possible.least)
    fault = Fault(
        device=service.device, kind=kind, start_s=start_s, duration_s=duration_s, amount=amount
    )
    post_fault(folder, fault)
    assert service.faults_at(-1.0) == [fault] * (start_s == 0.0)
    assert service.faults_at(-1.0 + start_s) == [fault]
    end_s = -1.0 + start_s + duration_s
    assert math.isinf(end_s) or service.faults_at(end_s) == []
    service.end_faults(set(FaultKind), now_s=math.inf)


def test_faults_are_heard_without_blocking(tmp_path: Path) -> None:
    """Faults arrive in order, once; the folder's path may be long."""
    folder = tmp_path / ("long" * 40)
    with _listening(folder) as service:
        assert service.faults_at(0.0) == []
        told = [parse_fault(text) for text in ("robot:delay=100ms+2s", "robot:freeze")]
        for fault in told:
            post_fault(folder, fault)
        assert service.faults_at(0.0) == service.faults_at(1.0) == told
    assert not control_path(folder, Device.ROBOT).exists()


@pytest.mark.parametrize("nonsense", [b"[" * 60_000, b'{"kind":' * 8_000, b"\xff\x00", b""])
def test_nonsense_ends_no_emulator(tmp_path: Path, nonsense: bytes) -> None:
    """Whatever comes, the next fault is heard."""
    with _listening(tmp_path) as service:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.sendto(nonsense, str(control_path(tmp_path, Device.ROBOT)))
        post_fault(tmp_path, parse_fault("robot:stall"))
        assert [fault.kind for fault in service.faults_at(0.0)] == [FaultKind.STALL]


def test_nobody_listens(tmp_path: Path) -> None:
    """Sending to an emulator that is not there says where it was looked for."""
    with pytest.raises(DeviceError, match=r"emulated robot: nothing listens at .*robot\.control"):
        post_fault(tmp_path, parse_fault("robot:freeze+1s"))


def test_a_dead_emulators_socket_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A socket file left behind by a kill does not stop the next emulator."""
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as dead:
        dead.bind(control_path(Path(), Device.CAMERA).name)
    assert control_path(tmp_path, Device.CAMERA).exists()
    with _listening(tmp_path, Device.CAMERA) as heir:
        post_fault(tmp_path, parse_fault("camera:unplug"))
        assert [fault.kind for fault in heir.faults_at(0.0)] == [FaultKind.UNPLUG]


def test_what_is_mended_is_over_and_what_is_to_come_stays(tmp_path: Path) -> None:
    """Unlocking ends the stop that is on, not the one that is planned."""
    with _listening(tmp_path) as service:
        for text in ("robot:protective-stop", "robot:protective-stop@9s", "robot:stall"):
            post_fault(tmp_path, parse_fault(text))
        service.faults_at(0.0)
        service.end_faults(STOPS, now_s=1.0)
        assert [fault.kind for fault in service.faults_at(1.0)] == [FaultKind.STALL]
        assert FaultKind.PROTECTIVE_STOP in {fault.kind for fault in service.faults_at(9.0)}


def _on(text: str) -> dict[FaultKind, Fault]:
    fault = parse_fault(text)
    return {fault.kind: fault}


def test_dropped_and_stalled_messages_never_leave() -> None:
    """Dropping loses the share asked for; stalling loses everything."""
    line = FaultyLine(0, garbled)
    for number in range(400):
        line.put(b"a", _on("camera:drop=50%"), due_ns=number)
    assert 150 < len(line.due(400)) < 250
    line.put(b"a", _on("camera:stall"), due_ns=400)
    assert line.next_due_ns is None


def test_delayed_messages_leave_late_in_order() -> None:
    """A delay keeps messages back and loses none, also when it ends."""
    line, late = FaultyLine(0, garbled), _on("camera:delay=250ms")
    for number in range(12):
        line.put(bytes([number]), late if number < 5 else {}, due_ns=number * 100_000_000)
    assert line.next_due_ns == 250_000_000
    assert line.due(249_999_999) == []
    assert b"".join(line.due(1_200_000_000)) == bytes(range(12))


def test_garbled_frames_are_damaged() -> None:
    """Garbling changes bytes and cuts the end off."""
    line, whole = FaultyLine(0, garbled), bytes(range(256)) * 40
    line.put(whole, _on("camera:garble=100%"), due_ns=0)
    [found] = line.due(0)
    assert len(found) < len(whole)
    assert found != whole[: len(found)]


PERIOD_NS = 10_000_000
NOISE_N = 0.008
FULL_SCALE_N = 50.0


def _felt(index: int, noise: random.Random) -> Vector6:
    """Return a force that rises by 0.3 N/s, with noise."""
    a, b, c, d, e, f = (noise.gauss(0.0, NOISE_N) for _ in range(6))
    return (0.5 + a, b, 2.0 + 3e-3 * index + c, d, e, 0.01 + f)


def _played(text: str, *, before: int = 400, during: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Return what was felt and what was said, [sample, 6], the fault on for the later ones."""
    noise, sensor = random.Random(1), SilentWrenchFaults(seed=1, full_scale_n=FULL_SCALE_N)  # noqa: S311
    felt = [_felt(index, noise) for index in range(before + during)]
    said = [
        sensor.reading(
            each, [parse_fault(text)] if index >= before else [], stamp_ns=index * PERIOD_NS
        )
        for index, each in enumerate(felt)
    ]
    assert said[:before] == felt[:before]
    return np.array(felt[before:]), np.array(said[before:])


@pytest.mark.parametrize(("text", "factor"), [("scale=0.1", 0.1), ("scale", 0.5), ("sign", -1.0)])
def test_scale_and_sign_turn_every_channel(text: str, factor: float) -> None:
    """All six channels are multiplied, noise and all."""
    felt, said = _played(f"force_sensor:{text}")
    np.testing.assert_allclose(said, factor * felt)


def test_swapped_axes() -> None:
    """F_z and F_x change places, M_z and M_x too."""
    felt, said = _played("force_sensor:swap-axes")
    np.testing.assert_array_equal(said, felt[:, [2, 1, 0, 5, 4, 3]])


def test_a_stuck_sensor_alternates_in_its_last_digit_alone() -> None:
    """Two values, a ten-thousandth apart: no two neighbours are equal."""
    _, said = _played("force_sensor:stick")
    assert len(np.unique(said[:, 2])) == 2
    np.testing.assert_allclose(np.abs(np.diff(said[:, 2])), 1e-4)


def test_a_sensor_that_sticks_noisily_keeps_its_mean_and_its_noise() -> None:
    """The mean stays where it was while the force rises by 1.2 N; the noise is the old one."""
    felt, said = _played("force_sensor:stick-noisily")
    assert felt[-1, 2] - felt[0, 2] > 1.0
    assert np.mean(said[:, 2]) == pytest.approx(felt[0, 2], abs=0.03)
    assert np.std(said[:, 2]) == pytest.approx(NOISE_N, rel=0.25)
    assert np.std(said[:, 1]) == pytest.approx(NOISE_N, rel=0.25)


def test_one_that_sticks_noisily_from_its_first_sample_has_noise_too() -> None:
    """It sticks after a second, when it knows its noise: without any it would be found at once."""
    felt, said = _played("force_sensor:stick-noisily", before=0, during=400)
    np.testing.assert_array_equal(said[:100], felt[:100])
    assert len(np.unique(said[:, 2])) == 400
    assert np.mean(said[100:, 2]) == pytest.approx(felt[100, 2], abs=0.03)
    assert np.std(said[100:, 2]) == pytest.approx(NOISE_N, rel=0.25)


def test_old_data_are_those_of_before() -> None:
    """What is said is what was felt two seconds ago."""
    felt, said = _played("force_sensor:old-data=2s")
    np.testing.assert_array_equal(said[200:], felt[:-200])


def test_old_data_begin_with_the_oldest() -> None:
    """Where nothing is old enough, the oldest sample stands in."""
    _, said = _played("force_sensor:old-data=3s", before=1, during=250)
    assert len(np.unique(said[:, 2])) == 1


def test_freeze_and_saturation() -> None:
    """A frozen sensor repeats itself; a saturated one reads its full scale in F_z alone."""
    felt, said = _played("force_sensor:freeze")
    assert np.all(said == felt[0])
    felt, said = _played("force_sensor:saturate")
    assert np.all(said[:, 2] == FULL_SCALE_N)
    np.testing.assert_array_equal(said[:, 0], felt[:, 0])


def test_a_second_time_it_sticks_where_it_is_then() -> None:
    """After a fault the sensor is honest, and the next one begins anew."""
    noise, sensor = random.Random(1), SilentWrenchFaults(seed=1, full_scale_n=FULL_SCALE_N)  # noqa: S311
    stuck = [parse_fault("force_sensor:freeze")]
    felt = [_felt(index, noise) for index in range(4)]
    said = [
        sensor.reading(each, faults, stamp_ns=index * PERIOD_NS)
        for index, (each, faults) in enumerate(zip(felt, (stuck, [], stuck, stuck), strict=True))
    ]
    assert said == [felt[0], felt[1], felt[2], felt[2]]


def test_images_freeze_and_repeat() -> None:
    """A frozen camera repeats one frame; a looping one the first few of its fault."""
    camera = SilentImageFaults()
    frames = [bytes([index]) for index in range(9)]
    freeze, loop = [parse_fault("camera:freeze-image")], [parse_fault("camera:repeat-image=3")]
    faults = [[], freeze, freeze, [], *[loop] * 5]
    said = [camera.frame(jpeg, on) for jpeg, on in zip(frames, faults, strict=True)]
    assert b"".join(said) == bytes([0, 1, 1, 3, 4, 5, 6, 4, 5])


def test_an_arm_drifts_and_its_clock_jumps() -> None:
    """While it moves the pose drifts as asked; both are right again when the fault ends."""
    arm = SilentArmFaults()
    still: Vector6 = (0.0,) * 6
    down: Vector6 = (0.0, 0.0, -1e-3, 0.0, 0.0, 0.0)
    on = [parse_fault("robot:wrong-pose=-0.2mm/s"), parse_fault("robot:clock-jump=-3s")]
    for _ in range(100):
        arm.advance(on, down, duration_s=0.008)
        arm.advance(on, still, duration_s=0.008)
    assert arm.height_m == pytest.approx(-0.16e-3)
    assert arm.clock_s == -3.0
    arm.advance([], still, duration_s=0.008)
    assert (arm.height_m, arm.clock_s) == (0.0, 0.0)
