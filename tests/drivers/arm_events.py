"""What an emulated arm noted of itself."""

from __future__ import annotations

import json
from pathlib import Path

from drivers.emulators.arm.controller import EVENTS_FILE


def read_events(folder: Path) -> list[dict[str, object]]:
    """Return the events written so far, oldest first."""
    lines = (folder / EVENTS_FILE).read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines if line.endswith("}")]
