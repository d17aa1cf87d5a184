"""What can be exported of a recording, by name."""

from __future__ import annotations

from enum import StrEnum


class ExportKind(StrEnum):
    """What is written."""

    CSV = "csv"
    IMAGES = "images"
