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
    InputRecipe,
    OutputRecipe,
    PacketKind,
    PacketReader,
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


@given(values=_values(OUTPUT_TYPES))
def test_outputs_round_trip(values: dict[str, tuple[float, ...]]) -> None:
    """What the controller packs is what a client unpacks, and the header's size is right."""
    recipe = OutputRecipe(1, list(values))
    packet = recipe.pack(values)
    ((kind, body),) = PacketReader().feed(packet)
    assert kind == PacketKind.DATA
    assert body[0] == 1
    assert recipe.unpack(body) == values


@given(values=_values(INPUT_TYPES))
def test_inputs_round_trip(values: dict[str, tuple[float, ...]]) -> None:
    """What a client packs is what the controller reads into its registers."""
    recipe = InputRecipe(list(values))
    packed = [struct.pack(">" + TYPE_FORMATS[INPUT_TYPES[name]], *values[name]) for name in values]
    inputs: dict[str, tuple[float, ...]] = {"untouched": (1.0,)}
    recipe.unpack_into(b"".join(packed), inputs)
    assert inputs == values | {"untouched": (1.0,)}


@given(
    first=st.tuples(*[st.floats(allow_nan=False)] * 6),
    second=st.tuples(*[st.floats(allow_nan=False)] * 6),
)
def test_changed_fields_are_repacked(first: tuple[float, ...], second: tuple[float, ...]) -> None:
    """Packing in place never keeps an old value of a field that changed."""
    recipe = OutputRecipe(1, ["timestamp", "actual_TCP_pose"])
    values = {"timestamp": (1.0,), "actual_TCP_pose": first}
    recipe.pack(values)
    values["actual_TCP_pose"] = second
    values["timestamp"] = (2.0,)
    assert recipe.pack(values)[4:] == struct.pack(">7d", 2.0, *second)


def test_says_what_is_wrong() -> None:
    """A size below the header's, and bodies of another length, are refused."""
    with pytest.raises(DeviceError, match="2 bytes long"):
        PacketReader().feed(b"\x00\x02U")
    with pytest.raises(DeviceError, match="3 bytes instead of 9"):
        OutputRecipe(1, ["timestamp"]).unpack(b"\x01\x00\x00")
    with pytest.raises(DeviceError, match="2 bytes instead of 4"):
        InputRecipe(["input_int_register_0"]).unpack_into(b"\x00\x00", {})
