"""A file of JSON lines that nothing depends on: what cannot be written is left out."""

from __future__ import annotations

import json
import logging
from contextlib import suppress
from pathlib import Path
from typing import Any

from tacauchy_rig.core.store.codec import to_json

logger = logging.getLogger(__name__)


class LineLog:
    """Appends lines; never waits for the disk, and gives up at the first line that it refuses.

    Args:
        path: The file; lines that it has stay.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = None
        try:
            self._file = path.open("a", encoding="utf-8", buffering=1)
        except OSError as error:
            logger.error("%s: not written: %s", path, error.strerror)

    def append(self, line: Any) -> None:
        """Append a dataclass as a line."""
        if self._file is None:
            return
        try:
            self._file.write(json.dumps(to_json(line), ensure_ascii=False) + "\n")
        except OSError as error:
            logger.error("%s: no longer written: %s", self._path, error.strerror)
            self.close()

    def close(self) -> None:
        """Close the file."""
        file, self._file = self._file, None
        if file is not None:
            with suppress(OSError):  # of a line that was reported
                file.close()
