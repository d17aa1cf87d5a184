"""The emulated force sensor's box: its commands, and a force that follows the arm's pose."""

import json
import math
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.emulators.force_sensor.m8128_box_and_noise import (
    TRACE_FILE,
    BoxCommands,
    WrenchSource,
    open_trace,
)
from drivers.emulators.plant.gel_response import Plant
from drivers.emulators.plant.truth import CylinderTip, draw_truth
from drivers.emulators.shared_world import SharedWorld
from drivers.force_sensor.sri_m3733c import SriM3733c
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import Checksum
from tacauchy_rig.core.run import Pose
from tests.drivers.conftest import changed, collect


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (b"AT+SMPF=100\r\n", b"ACK+SMPF=100$OK\r\n"),
        (b"AT+DCKMD=SUM\r\n", b"ACK+DCKMD=SUM$OK\r\n"),
        (b"AT+GSD=STOP\r\n", b"ACK+GSD=STOP$OK\r\n"),
        (b"AT+DCKMD=MD5\r\n", b"ACK+DCKMD=MD5$ERROR\r\n"),
        (b"AT+SMPF=0\r\n", b"ACK+SMPF=0$ERROR\r\n"),
        (b"AT+NOPE=1\r\n", b"ACK+NOPE=1$ERROR\r\n"),
        (b"nonsense\r\n", b""),
    ],
)
def test_replies(line: bytes, reply: bytes) -> None:
    """Each command gets the reply that the documents show."""
    assert BoxCommands().receive(line) == reply


def test_settings_take_effect_and_are_told() -> None:
    """What is set is used, and a query returns it."""
    box = BoxCommands()
    box.receive(b"AT+SMPF=250\r\nAT+DCKMD=CRC32\r\nAT+GSD\r\n")
    assert (box.rate_hz, box.checksum, box.streaming) == (250, Checksum.CRC32, True)
    assert box.receive(b"AT+SMPF=?\r\n") == b"ACK+SMPF=250$OK\r\n"
    box.receive(b"AT+GSD=STOP\r\n")
    assert not box.streaming


def test_older_box_knows_the_other_name() -> None:
    """A box of the older kind refuses the newer name."""
    box = BoxCommands(quirks=frozenset({"smpr"}))
    assert box.receive(b"AT+SMPF=50\r\n") == b"ACK+SMPF=50$ERROR\r\n"
    assert box.receive(b"AT+SMPR=50\r\n") == b"ACK+SMPR=50$OK\r\n"
    assert box.rate_hz == 50


@pytest.mark.parametrize(("quirk", "reply"), [("bare", b"ACK+SMPF=50OK\r\n"), ("silent", b"")])
def test_reply_styles(quirk: str, reply: bytes) -> None:
    """The box can answer as other documents say, or not at all, and still obeys."""
    box = BoxCommands(quirks=frozenset({quirk}))
    assert box.receive(b"AT+SMPF=50\r\n") == reply
    assert box.rate_hz == 50


@settings(deadline=None)
@given(st.lists(st.integers(1, 12), max_size=12))
def test_any_chunking_of_commands(cuts: list[int]) -> None:
    """Commands may arrive in any pieces."""
    data = b"AT+SMPF=200\r\nAT+GSD\r\n"
    box = BoxCommands()
    replies = b""
    for length in [*cuts, len(data)]:
        replies += box.receive(data[:length])
        data = data[length:]
    assert replies == b"ACK+SMPF=200$OK\r\nACK+GSD=$OK\r\n"


SURFACE = (0.0, -0.4, 0.2)


@pytest.mark.parametrize("sign", [1, -1])
def test_reading_is_the_plants_force_with_offset_and_noise(tmp_path: Path, sign: int) -> None:
    """Free before any pose and above the gel; pressed, Fz rises by the true force, or falls."""
    truth = draw_truth(7)
    plant = Plant(truth, CylinderTip(diameter_m=5e-3), SURFACE)
    world = SharedWorld.create(tmp_path / "world")
    source = WrenchSource(plant, world, compression_sign=sign)
    now_ns = time.monotonic_ns()
    assert source.read(now_ns)[1:] == (0.0, None)

    top_z = SURFACE[2] + truth.surface_error_m
    down = (0.0, math.pi, 0.0)
    pressed = Pose(position=(SURFACE[0], SURFACE[1], top_z - 4e-4), rotation_vector=down)
    world.publish(pressed, now_ns)
    reading, force_n, depth_m = source.read(now_ns + 10_000_000)
    assert depth_m == pytest.approx(4e-4, abs=1e-6)
    assert 1.0 < force_n < 5.0
    noise_n = truth.force_noise_n
    assert reading[2] - truth.force_offset_n[2] == pytest.approx(sign * force_n, abs=5 * noise_n)
    hung = source.read(now_ns + 20_000_000, hung_kg=0.1)[0][2] - reading[2]
    assert hung == pytest.approx(-sign * 0.981, abs=0.02 + 10 * noise_n)


def rows(path: Path) -> list[dict[str, object]]:
    """Return the frames of the trace that can be read."""
    found = []
    for line in path.read_text().splitlines():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        if "stamp_ns" in row:
            found.append(row)
    return found


def write(path: Path, stamp_ns: int, *, boot_id: str) -> None:
    """Open the trace, add a row, close it."""
    with open_trace(path, boot_id=boot_id) as trace:
        trace.write(json.dumps({"stamp_ns": stamp_ns}) + "\n")


def test_a_second_start_on_the_same_boot_continues_the_trace(tmp_path: Path) -> None:
    """A last line that a kill has torn costs nothing but itself."""
    path = tmp_path / TRACE_FILE
    write(path, 1, boot_id="a")
    with path.open("a") as file:
        file.write('{"stamp_ns": 2, "forc')
    write(path, 3, boot_id="a")
    write(path, 4, boot_id="a")
    assert [row["stamp_ns"] for row in rows(path)] == [1, 3, 4]


@pytest.mark.parametrize("before", ["", '{"stamp_ns": 1}\n', '{"boot_id": "b"}\n{"stamp_ns": 1}\n'])
def test_stamps_of_no_boot_or_another_are_not_mixed_in(tmp_path: Path, before: str) -> None:
    """The monotonic clock begins anew with each boot; so does the trace."""
    path = tmp_path / TRACE_FILE
    path.write_text(before)
    write(path, 7, boot_id="a")
    assert [row["stamp_ns"] for row in rows(path)] == [7]


def test_a_box_that_is_started_again_keeps_what_it_traced_before(
    tmp_path: Path, run_box: Callable[..., AbstractContextManager[str]]
) -> None:
    """As in a resumed dry run: every frame of every start is there, stamps in order."""
    kept: list[dict[str, object]] = []
    for _ in range(3):
        with run_box(tmp_path) as port:
            _stream(port, count=20)
        now = rows(tmp_path / TRACE_FILE)
        assert now[: len(kept)] == kept
        assert len(now) >= len(kept) + 20
        kept = now
    stamps = [int(str(row["stamp_ns"])) for row in kept]
    assert stamps == sorted(stamps)


def _stream(port: str, *, count: int) -> None:
    """Let the box stream until a client has ``count`` frames."""
    sensor = SriM3733c(changed(load_config().config, force_sensor={"port": port}))
    try:
        sensor.connect()
        collect(sensor, lambda found: len(found) >= count)
    finally:
        sensor.close()
