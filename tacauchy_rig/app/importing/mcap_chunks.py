"""An MCAP file's chunks, looked at before a reader unpacks them: none may say or be too much.

A chunk is a record of opcode 6: two times, its size unpacked, a checksum, the name of its packing
and its packed records, each with its length before it (mcap.dev, specification of version 0).
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO, Protocol

from backports import zstd
from lz4.frame import LZ4FrameDecompressor

from tacauchy_rig.app.importing.source import MIB
from tacauchy_rig.core.errors import RecordError

CHUNK_BYTES = 256 * MIB
"""Of a chunk unpacked; writers begin a new one after some megabytes."""
RECORDS_MOST = 20_000_000
MAGIC = b"\x89MCAP0\r\n"
_CHUNK = 6
_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct(
    "<QQQII"
)  # times, size unpacked, checksum, length of the packing's name
_LENGTH = struct.Struct("<Q")
_PIECE = MIB


class _Unpacks(Protocol):
    @property
    def eof(self) -> bool: ...
    @property
    def needs_input(self) -> bool: ...
    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...


def check_chunks(path: Path, *, name: str) -> None:
    """Refuse a file whose records or chunks are larger than they may be.

    Args:
        name: Of the file, for messages.

    Raises:
        RecordError: A record is longer than its file, or a chunk unpacks to too much.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise _broken(name, "does not begin as one")
        for _ in range(RECORDS_MOST):
            at = file.tell()
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size or head == (MAGIC + MAGIC)[: _HEAD.size]:
                return  # its end, which the reader judges
            opcode, length = _HEAD.unpack(head)
            if length > size - file.tell():
                raise _broken(name, f"its record at byte {at} says to be {length} bytes long")
            end = file.tell() + length
            if opcode == _CHUNK:
                _check_chunk(file, length, at=at, name=name)
            file.seek(end)
    raise _broken(name, f"more than {RECORDS_MOST} records")


def _check_chunk(file: BinaryIO, length: int, *, at: int, name: str) -> None:
    where = f"its chunk at byte {at}"
    head = file.read(min(length, _CHUNK_HEAD.size))
    if len(head) < _CHUNK_HEAD.size:
        raise _broken(name, f"{where} is cut off")
    *_, said, _, letters = _CHUNK_HEAD.unpack(head)
    if said > CHUNK_BYTES:
        raise _broken(name, f"{where} unpacks to {said} bytes; at most {CHUNK_BYTES} are read")
    packing = file.read(min(letters, length))
    packed_length = _LENGTH.unpack(file.read(_LENGTH.size).ljust(_LENGTH.size, b"\0"))[0]
    if packed_length > length:
        raise _broken(name, f"{where} says to hold {packed_length} bytes of its {length}")
    unpacking = {b"lz4": LZ4FrameDecompressor, b"zstd": zstd.ZstdDecompressor}.get(packing)
    if unpacking is not None and _is_longer(unpacking(), file, packed_length, said):
        raise _broken(name, f"{where} says to unpack to {said} bytes and goes on")


def _is_longer(unpacks: _Unpacks, file: BinaryIO, packed: int, said: int) -> bool:
    """Return whether packed bytes give more than they say; never more than a piece is in memory."""
    found = 0
    while packed > 0 or not unpacks.needs_input:
        data = b""
        if unpacks.needs_input:
            data = file.read(min(packed, _PIECE))
            packed -= len(data)
            if not data:
                return False  # the reader says that it is cut off
        try:
            found += len(unpacks.decompress(data, max_length=_PIECE))
        except (RuntimeError, EOFError, zstd.ZstdError):
            return False  # the reader says that it is damaged
        if found > said:
            return True
        if unpacks.eof:
            return False
    return False


def _broken(name: str, why: str) -> RecordError:
    return RecordError(
        f"{name}: no MCAP file that is read: {why}",
        remedy="record it anew in chunks of some megabytes, or copy it anew from its source",
    )
