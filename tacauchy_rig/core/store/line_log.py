"""A file of JSON lines that nothing depends on: what cannot be written is left out."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.codec import loads, to_json
from tacauchy_rig.core.store.run_files import read_bytes

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
        if file is None:
            return
        try:
            file.close()
        except OSError as error:
            logger.error("%s: its end was not written: %s", self._path, error.strerror)


def read_log(path: Path) -> list[dict[str, Any]]:
    """Return the whole lines of a log; none where there is no file."""
    if not path.is_file():
        return []
    lines = []
    for line in read_bytes(path, what="the log").splitlines():
        try:
            lines.append(loads(line, source=str(path)))
        except RecordError as error:
            logger.info("%s: passed over", error.message)
    return lines
