"""What the benchmark can measure, by name."""

from __future__ import annotations

from enum import StrEnum


class Part(StrEnum):
    """Parts of the benchmark, in the order of its page."""

    RENDERING = "rendering"
    REPLAY = "replay"
    GROWTH = "growth"
    SCENES = "scenes"
    START = "start"
    THREADS = "threads"


REFERENCE_FILE = "scenes_reference.json"
"""What the scenes' forces are compared with, beside their page."""
SCENE_LIMIT_S = 900.0
"""Processor time after which a scene is given up [s]."""
