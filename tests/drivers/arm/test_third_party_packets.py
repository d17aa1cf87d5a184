"""RTDE packets that others recorded, decoded by our wire code: Universal Robots' client library.

Bytes and expected values are read from the sources of that library's own tests (Apache-2.0), which
are not part of this repository: set ``UR_CLIENT_LIBRARY`` to a checkout of
``UniversalRobots/Universal_Robots_Client_Library`` (tried with 2.14).
"""

from __future__ import annotations

import os
import re
import struct
from pathlib import Path

import pytest

from drivers.arm.ur5_wire import (
    OutputRecipe,
    PacketKind,
    PacketReader,
    pack_packet,
    split_names,
)

_CHECKOUT = os.environ.get("UR_CLIENT_LIBRARY", "")
pytestmark = pytest.mark.skipif(not _CHECKOUT, reason="UR_CLIENT_LIBRARY names no checkout")


def body_of(file: str, test: str) -> str:
    """Return the source of one of the library's tests."""
    source = (Path(_CHECKOUT) / "tests" / file).read_text("utf-8")
    return source.split(f"{test})\n", 1)[1].split("\nTEST(", 1)[0]


def bytes_in(source: str) -> bytes:
    """Return the first array of bytes in a source."""
    found = re.search(r"\[\] = \{([^}]*)\}", source)
    assert found is not None
    return bytes(int(number, 16) for number in found[1].split(",") if number.strip())


def packet_of(test: str) -> tuple[int, bytes]:
    """Return kind and body of the packet that one of the parser's tests takes."""
    (packet,) = PacketReader().feed(bytes_in(body_of("test_rtde_parser.cpp", test)))
    return packet


@pytest.mark.parametrize(
    ("test", "kind"),
    [
        ("request_protocol_version", PacketKind.REQUEST_PROTOCOL_VERSION),
        ("control_package_start", PacketKind.START),
        ("control_package_pause", PacketKind.PAUSE),
    ],
)
def test_acceptances(test: str, kind: PacketKind) -> None:
    """A packet of one byte that says yes, which ours writes alike."""
    assert packet_of(test) == (kind, b"\1")
    assert pack_packet(kind, b"\1") == bytes_in(body_of("test_rtde_parser.cpp", test))


def test_version() -> None:
    """Four numbers."""
    source = body_of("test_rtde_parser.cpp", "get_urcontrol_version")
    expected = [int(number) for number in re.findall(r"version_information_\.\w+, (\d+)", source)]
    kind, body = packet_of("get_urcontrol_version")
    assert kind == PacketKind.GET_URCONTROL_VERSION
    assert list(struct.unpack("!4I", body)) == expected


def test_types_of_a_recipe() -> None:
    """The identifier, then the types with commas between them.

    The library's packet of output types says 17 bytes and has 19, so it is not compared.
    """
    source = body_of("test_rtde_parser.cpp", "control_package_setup_inputs")
    expected = re.search(r'variable_types_, "([^"]*)"', source)
    _, body = packet_of("control_package_setup_inputs")
    assert expected is not None
    assert body[0] == 1
    assert split_names(body[1:]) == expected[1].split(",")


def test_a_data_packet() -> None:
    """Time stamp and speed fraction of a recorded packet."""
    source = body_of("test_rtde_parser.cpp", "data_package")
    expected = re.search(r"DOUBLE_EQ\(timestamp, ([\d.]+)\)", source)
    kind, body = packet_of("data_package")
    values = OutputRecipe(1, ["timestamp", "target_speed_fraction"]).unpack(body)
    assert expected is not None
    assert kind == PacketKind.DATA
    assert values == {"timestamp": (float(expected[1]),), "target_speed_fraction": (1.0,)}


def test_joint_angles() -> None:
    """A recorded arm: a time and a vector of six."""
    source = body_of("test_rtde_data_package.cpp", "parse_pkg_protocolv2")
    angles = re.search(r"expected_q = \{([^}]*)\}", source)
    stamp = re.search(r"expected_timestamp = ([\d.]+)", source)
    values = OutputRecipe(1, ["timestamp", "actual_q"]).unpack(bytes_in(source))
    assert angles is not None
    assert stamp is not None
    expected = [float(angle) for angle in angles[1].split(",")]
    assert values["actual_q"] == pytest.approx(expected, abs=1e-4)
    assert values["timestamp"] == pytest.approx([float(stamp[1])], abs=1e-4)
