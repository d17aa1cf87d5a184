"""What the benchmark can measure, by name."""

from __future__ import annotations

from enum import StrEnum


class Part(StrEnum):
    """Parts of the benchmark, in the order of its page."""

    FRAMES = "frames"
    REUSE = "reuse"
    BATCHES = "batches"
    PHASES = "phases"
    RENDERING = "rendering"
    REPLAY = "replay"
    GROWTH = "growth"


class Peer(StrEnum):
    """Other engines that can be measured beside the batches."""

    LIBUIPC = "libuipc"
