"""The force sensor's driver: real pyserial against the emulated box on a pseudo-terminal."""

import json
import os
import pty
import signal
import subprocess
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from drivers.device_holders import device_holders
from drivers.emulators.faults import FaultKind, parse_fault
from drivers.emulators.force_sensor.m8128_box_and_noise import LINK_NAME
from drivers.emulators.process import post_fault
from drivers.force_sensor.sri_m3733c import SriM3733c, explain_open_error
from drivers.interfaces import DeviceIdentity
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import Checksum
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import ForceSample
from tests.drivers.conftest import changed, collect, wait_until

RunBox = Callable[..., AbstractContextManager[str]]


@pytest.fixture(scope="module")
def box(run_box: RunBox, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, str]]:
    """One emulated box for the tests that leave it as it was: its folder and its port."""
    folder = tmp_path_factory.mktemp("box")
    with run_box(folder) as port:
        yield folder, port


def sensor_at(port: str, **changes: object) -> SriM3733c:
    """Return a driver for ``port``, fields of ``[force_sensor]`` changed, not yet connected."""
    section = {"driver": "m3733c", "port": port, **changes}
    return SriM3733c(changed(load_config().config, force_sensor=section))


@contextmanager
def connected(port: str, **changes: object) -> Iterator[SriM3733c]:
    """Yield a connected driver and close it."""
    sensor = sensor_at(port, **changes)
    try:
        sensor.connect()
        yield sensor
    finally:
        sensor.close()


def test_streams_with_consecutive_counters_and_arrival_stamps(box: tuple[Path, str]) -> None:
    """A hundred frames arrive in order, none lost, stamped by the monotonic clock."""
    before = time.monotonic_ns()
    with connected(box[1]) as sensor:
        samples = collect(sensor, lambda found: len(found) >= 100)
        health = sensor.health()
    counters = [sample.counter for sample in samples]
    assert counters == list(range(counters[0], counters[0] + len(counters)))
    stamps = [sample.stamp_ns for sample in samples]
    assert stamps == sorted(stamps)
    assert before < stamps[0] < stamps[-1] <= time.monotonic_ns()
    assert (health.lost_count, health.corrupt_count) == (0, 0)
    mean = sum(sample.wrench[2] for sample in samples) / len(samples)
    assert mean == pytest.approx(3.0, abs=0.002)


def identified(port: str, **changes: object) -> DeviceIdentity:
    """Return what a driver says of its box."""
    sensor = sensor_at(port, **changes)
    try:
        return sensor.connect()
    finally:
        sensor.close()


def test_identity_records_what_was_set(box: tuple[Path, str]) -> None:
    """The identity says what the box was told and what it acknowledged, either checksum."""
    identity = identified(box[1], rate=200)
    assert identity.simulated  # a pseudo-terminal is no sensor, whatever it was opened as
    assert identity.address == box[1]
    assert (identity.settings["SMPF"], identity.settings["DCKMD"]) == ("200", "SUM")
    assert identified(box[1], checksum=Checksum.CRC32).settings["DCKMD"] == "CRC32"


@pytest.mark.parametrize(
    ("quirks", "name", "told"),
    [({"smpr", "bare"}, "SMPR", "100"), ({"silent"}, "DCKMD", "SUM (not acknowledged)")],
)
def test_other_boxes_are_set_up_all_the_same(
    run_box: RunBox, tmp_path: Path, quirks: set[str], name: str, told: str
) -> None:
    """One that knows SMPR only and answers without a dollar sign, and one that says nothing."""
    with run_box(tmp_path, quirks=quirks) as port:
        identity = identified(port, connect_timeout=10.0)
    assert identity.settings[name] == told
    assert ("SMPF" in identity.settings) is (name != "SMPR")


def test_close_and_open_again(box: tuple[Path, str]) -> None:
    """The same box serves a second client, and a stream left on is no obstacle."""
    with connected(box[1]) as first:
        collect(first, lambda found: len(found) >= 3)
    descriptor = os.open(box[1], os.O_RDWR | os.O_NOCTTY)
    os.write(descriptor, b"AT+GSD\r\n")  # as a killed program would leave it
    os.close(descriptor)
    with connected(box[1]) as second:
        assert collect(second, lambda found: len(found) >= 3)
        assert second.health().lost_count == 0


def test_close_twice_and_before_connect() -> None:
    """Closing is always allowed, and leaves a sensor that nothing came from."""
    sensor = sensor_at("/dev/never-opened")
    sensor.close()
    sensor.close()
    assert sensor.drain() == []
    assert sensor.health().received_count == 0


def test_freeze_is_seen_as_repeats(box: tuple[Path, str]) -> None:
    """Equal samples with a moving counter raise the repeat count and nothing else."""
    with connected(box[1]) as sensor:
        post_fault(box[0], parse_fault("force_sensor:freeze+500ms"))
        collect(sensor, lambda _: sensor.health().repeat_count >= 20)
        assert sensor.health().lost_count == 0


def test_dropped_frames_are_counted(box: tuple[Path, str]) -> None:
    """Gaps in the package number are lost frames; counters keep them visible."""
    with connected(box[1]) as sensor:
        post_fault(box[0], parse_fault("force_sensor:drop=50%+800ms"))
        samples = collect(sensor, lambda _: sensor.health().lost_count >= 20)
        last = samples[-1].counter - samples[0].counter + 1
        assert last - len(samples) == pytest.approx(sensor.health().lost_count, abs=3)
        assert sensor.health().corrupt_count == 0


def test_garbled_frames_are_counted_and_never_delivered(box: tuple[Path, str]) -> None:
    """Damaged frames show as corrupt; what is delivered holds the true load."""
    with connected(box[1]) as sensor:
        post_fault(box[0], parse_fault("force_sensor:garble=40%+800ms"))
        samples = collect(sensor, lambda _: sensor.health().corrupt_count >= 20)
    wrong = [s for s in samples if abs(s.wrench[2] - 3.0) > 0.05]
    assert len(wrong) <= 1  # one in 256 damaged frames has a right sum by chance


def test_saturation_reads_full_scale(run_box: RunBox, tmp_path: Path) -> None:
    """A saturated channel reads the full scale, and comes back."""
    with run_box(tmp_path, capacity=40.0) as port, connected(port) as sensor:
        post_fault(tmp_path, parse_fault("force_sensor:saturate+200ms"))
        samples = collect(sensor, lambda found: bool(found) and found[-1].wrench[2] == 40)
        samples += collect(sensor, lambda found: bool(found) and found[-1].wrench[2] < 4)
    assert {round(s.wrench[2]) for s in samples} == {3, 40}


@pytest.mark.parametrize("kind", [FaultKind.STALL, FaultKind.DELAY])
def test_silence_shows_as_age(box: tuple[Path, str], kind: FaultKind) -> None:
    """While nothing comes the age grows and draining does not block."""
    with connected(box[1]) as sensor:
        post_fault(box[0], parse_fault(f"force_sensor:{kind}+400ms"))
        collect(sensor, lambda _: sensor.health().age_s > 0.1)
        assert sensor.drain() == []
        assert collect(sensor, lambda found: len(found) >= 5)


def test_unplug_raises_after_the_last_sample(run_box: RunBox, tmp_path: Path) -> None:
    """Samples that came before the plug was pulled are returned first, then the error."""
    with run_box(tmp_path) as port, connected(port) as sensor:
        post_fault(tmp_path, parse_fault("force_sensor:unplug"))
        wait_until(lambda: not Path(port).exists())
        wait_until(lambda: sensor.health().age_s > 0.2)
        assert sensor.drain()
        for _ in range(2):
            with pytest.raises(DeviceError, match="is gone"):
                sensor.drain()


def test_a_plug_put_in_again_serves_a_new_connection(run_box: RunBox, tmp_path: Path) -> None:
    """At the end of an unplugging the port is back, at the same link."""
    link = tmp_path / LINK_NAME
    with run_box(tmp_path) as port:
        with connected(port) as sensor:
            post_fault(tmp_path, parse_fault("force_sensor:unplug+500ms"))
            wait_until(lambda: not link.exists())
            wait_until(lambda: sensor.health().age_s > 0.2)
        wait_until(link.exists)
        with connected(str(link)) as sensor:
            assert collect(sensor, lambda found: len(found) >= 3)


@pytest.mark.parametrize(
    ("lie", "expected"),
    [
        ("scale=0.1", (0.05, -0.025, 0.3)),
        ("sign", (-0.5, 0.25, -3.0)),
        ("swap-axes", (3.0, -0.25, 0.5)),
        ("stick", (0.5, -0.25, 3.0)),
        ("stick-noisily", (0.5, -0.25, 3.0)),
        ("old-data=200ms", (0.5, -0.25, 3.0)),
    ],
)
def test_a_lie_shows_in_no_count(
    box: tuple[Path, str], lie: str, expected: tuple[float, float, float]
) -> None:
    """A sensor that lies streams without a loss, a repeat or an error: nothing betrays it."""
    with connected(box[1]) as sensor:
        sensor.drain()
        post_fault(box[0], parse_fault(f"force_sensor:{lie}+2s"))

        def says_so(found: list[ForceSample]) -> bool:
            return len(found) >= 40 and found[-1].wrench[:3] == pytest.approx(expected, abs=0.05)

        collect(sensor, says_so)
        assert sensor.health().repeat_count < 3
        assert (sensor.health().lost_count, sensor.health().corrupt_count) == (0, 0)


def test_box_that_hangs_holds_up_neither_drain_nor_close(run_box: RunBox, tmp_path: Path) -> None:
    """With the box's process stopped, draining, closing and a new connect return."""
    with run_box(tmp_path) as port, connected(port) as sensor:
        ready = json.loads((tmp_path / "ready.json").read_text())
        os.kill(ready["pid"], signal.SIGSTOP)
        collect(sensor, lambda _: sensor.health().age_s > 0.1)
        assert sensor.drain() == []
        sensor.close()
        second = sensor_at(port, connect_timeout=0.1)
        with pytest.raises(DeviceError, match="silent"):
            second.connect()
        os.kill(ready["pid"], signal.SIGKILL)


def test_second_owner_is_refused(box: tuple[Path, str]) -> None:
    """The port is open for one owner alone."""
    with connected(box[1]) as sensor:
        with pytest.raises(DeviceError, match="in use"):
            sensor_at(box[1]).connect()
        assert collect(sensor, lambda found: len(found) >= 3)


def test_other_program_is_named(box: tuple[Path, str]) -> None:
    """A program that holds the port without locking it is found and named."""
    with Path(box[1]).open("rb", buffering=0) as other:
        program = subprocess.Popen(["sleep", "30"], stdin=other)
    try:
        assert device_holders(box[1]) == [f"sleep (pid {program.pid})"]
        with pytest.raises(DeviceError, match=rf"in use by sleep \(pid {program.pid}\)"):
            sensor_at(box[1]).connect()
    finally:
        program.kill()
        program.wait()


def test_absent_port() -> None:
    """A port that is not there is named, with where to look."""
    with pytest.raises(DeviceError, match="/dev/ttyUSB77 does not exist") as caught:
        sensor_at("/dev/ttyUSB77").connect()
    assert "/dev/serial/by-id" in caught.value.remedy


def test_no_permission(run_box: RunBox, tmp_path: Path) -> None:
    """A port that this user may not open names the group to join."""
    with run_box(tmp_path) as port:
        Path(port).chmod(0)
        user = os.geteuid()
        try:
            if user == 0:
                os.seteuid(65534)
            with pytest.raises(DeviceError, match="no permission") as caught:
                sensor_at(port).connect()
        finally:
            os.seteuid(user)
    assert "dialout" in caught.value.remedy


def test_plain_file_is_no_port(tmp_path: Path) -> None:
    """A path that is no serial port says so."""
    path = tmp_path / "file"
    path.write_bytes(b"")
    with pytest.raises(DeviceError, match="cannot be used as a serial port"):
        sensor_at(str(path)).connect()


def test_unexplained_error_keeps_its_text() -> None:
    """An error of an unknown kind is passed on in words."""
    assert "odd parity" in str(explain_open_error("/dev/x", ValueError("odd parity")))


@contextmanager
def raw_terminal() -> Iterator[tuple[int, str]]:
    """Yield the device end of a pseudo-terminal and the path of the other."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    try:
        yield master, os.ttyname(slave)
    finally:
        os.close(master)
        os.close(slave)


def test_silent_port_names_the_deadline() -> None:
    """A port with nothing behind it fails at the deadline and says what to check."""
    with raw_terminal() as (_, port), pytest.raises(DeviceError, match="silent") as caught:
        sensor_at(port, connect_timeout=2.5).connect()
    assert "115200 baud" in caught.value.remedy


def test_other_device_shows_what_it_said() -> None:
    """A device that talks something else is quoted."""
    with raw_terminal() as (master, port):
        chatter = subprocess.Popen(["yes", "$GPGGA,nothing"], stdout=master)
        try:
            with pytest.raises(DeviceError, match="other than SUM frames") as caught:
                sensor_at(port, connect_timeout=3.0).connect()
        finally:
            chatter.kill()
            chatter.wait()
    assert "baud_rate" in caught.value.remedy


def test_rate_that_does_not_fit_the_line() -> None:
    """More frames than the baud rate carries is refused before anything is opened."""
    with pytest.raises(DeviceError, match="500 Hz needs 155000 baud"):
        sensor_at("/dev/ttyUSB77", rate=500.0).connect()
