"""The pseudo-terminal that an emulated force sensor serves as its serial port."""

from __future__ import annotations

import logging
import os
import pty
import tty
from pathlib import Path

_logger = logging.getLogger(__name__)


class PseudoPort:
    """The device end of a pseudo-terminal; the other end looks like a serial port."""

    def __init__(self, link: Path) -> None:
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self._master, False)
        self._link = link
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(self.path)
        self.is_open = False

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._master

    def read(self) -> bytes:
        """Return what the client has sent; notes whether one has the port open."""
        try:
            data = os.read(self._master, 4096)
        except BlockingIOError:
            self.is_open = True
            return b""
        except OSError:  # EIO: nobody has the other end open
            self.is_open = False
            return b""
        self.is_open = True
        return data

    def write(self, data: bytes) -> None:
        """Send to the client; what does not fit or has no listener is gone, as on a wire."""
        if not (self.is_open and data):
            return
        try:
            os.write(self._master, data)
        except OSError as error:
            _logger.debug("%d bytes dropped: %s", len(data), error)

    def close(self) -> None:
        """Pull the plug: the client's next read fails."""
        os.close(self._master)
        self._link.unlink(missing_ok=True)
