"""RTDE packets and recipes, without a socket."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.arm.ur5_wire import (
    INPUT_TYPES,
    OUTPUT_TYPES,
    TYPE_FORMATS,
    PacketReader,
    Recipe,
    pack_packet,
)
from tacauchy_rig.core.errors import DeviceError

_SCALARS = {
    "d": st.floats(allow_nan=False),
    "i": st.integers(-(2**31), 2**31 - 1),
    "I": st.integers(0, 2**32 - 1),
    "Q": st.integers(0, 2**64 - 1),
    "B": st.integers(0, 255),
    "?": st.booleans(),
}


def _values(types: dict[str, str]) -> st.SearchStrategy[dict[str, tuple[float, ...]]]:
    def of(names: list[str]) -> st.SearchStrategy[dict[str, tuple[float, ...]]]:
        fields = {}
        for name in names:
            layout = TYPE_FORMATS[types[name]]
            count = int(layout[:-1] or "1")
            fields[name] = st.tuples(*[_SCALARS[layout[-1]]] * count)
        return st.fixed_dictionaries(fields)

    names = st.lists(st.sampled_from(sorted(types)), unique=True, min_size=1, max_size=12)
    return names.flatmap(of)


@given(
    packets=st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=60)), max_size=6),
    cuts=st.lists(st.integers(1, 7), min_size=1, max_size=400),
)
def test_packets_survive_any_cutting(packets: list[tuple[int, bytes]], cuts: list[int]) -> None:
    """However the stream is cut up, the same packets come out."""
    stream = b"".join(pack_packet(kind, body) for kind, body in packets)
    reader = PacketReader()
    got: list[tuple[int, bytes]] = []
    while stream:
        size = cuts[len(got) % len(cuts)]
        got += reader.feed(stream[:size])
        stream = stream[size:]
    assert got == packets


@given(values=_values(OUTPUT_TYPES | INPUT_TYPES))
def test_fields_round_trip(values: dict[str, tuple[float, ...]]) -> None:
    """What one side packs is what the other unpacks, each field in its own format."""
    types = OUTPUT_TYPES | INPUT_TYPES
    recipe = Recipe(list(values), types)
    packed = [struct.pack(">" + TYPE_FORMATS[types[name]], *values[name]) for name in values]
    assert recipe.pack(values) == b"".join(packed)
    assert recipe.unpack(b"".join(packed)) == values


def test_says_what_is_wrong() -> None:
    """A size below the header's, and bodies of another length, are refused."""
    with pytest.raises(DeviceError, match="2 bytes long"):
        PacketReader().feed(b"\x00\x02U")
    with pytest.raises(DeviceError, match="2 bytes instead of 8"):
        Recipe(["timestamp"], OUTPUT_TYPES).unpack(b"\x00\x00")
