"""The benchmark: how long the simulator's work takes, in parts and in scenes of every kind."""

from enum import StrEnum


class Part(StrEnum):
    """Parts of the benchmark, in the order of its page."""

    REPLAY = "replay"
    RENDERING = "rendering"
    UNLIKE = "unlike"
    MOVING = "moving"
    ALONE = "alone"
    SCENES = "scenes"
