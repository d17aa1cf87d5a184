"""The load of browsers without any: reads a page's events and fetches pictures, until killed."""

import contextlib
import http.client
import sys
import threading
import time
from urllib.parse import urlsplit

PICTURE_S = 0.1


def watch(address: str, count: int) -> None:
    """Watch a page as ``count`` browsers would."""
    for _ in range(count):
        threading.Thread(target=_read_events, args=(address,), daemon=True).start()
    while True:
        for name in ("camera", "reference"):
            with contextlib.suppress(OSError, http.client.HTTPException):
                _get(address, f"picture/{name}").read()
        time.sleep(PICTURE_S / count)


def _read_events(address: str) -> None:
    while True:
        with contextlib.suppress(OSError, http.client.HTTPException):
            answer = _get(address, "events")
            while answer.readline():
                pass
        time.sleep(0.2)


def _get(address: str, path: str) -> http.client.HTTPResponse:
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=5.0)
    connection.request("GET", parts.path + path)
    return connection.getresponse()


if __name__ == "__main__":
    watch(sys.argv[1], int(sys.argv[2]))
