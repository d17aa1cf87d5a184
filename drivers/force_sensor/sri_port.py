"""Open a serial port for one process alone, and say in plain words why it could not be opened."""

from __future__ import annotations

import errno
import logging
import os
from pathlib import Path

import serial
from serial.tools import list_ports

from drivers.device_file import device_holders
from tacauchy_rig.errors import DeviceError

_logger = logging.getLogger(__name__)

READ_TIMEOUT_S = 0.05
WRITE_TIMEOUT_S = 0.5


def open_port(path: str, *, baud_rate: int) -> serial.Serial:
    """Open ``path`` exclusively, 8N1, and ask the adapter for low latency where it can.

    Raises:
        DeviceError: Absent, no permission, in use, or not a serial port; each with its remedy.
    """
    holders = device_holders(path)
    if holders:
        raise _in_use(path, holders)
    try:
        port = serial.Serial(
            path,
            baudrate=baud_rate,
            timeout=READ_TIMEOUT_S,
            write_timeout=WRITE_TIMEOUT_S,
            exclusive=True,
        )
    except (OSError, ValueError) as error:
        raise explain_open_error(path, error) from error
    try:
        port.set_low_latency_mode(True)
    except (OSError, ValueError, NotImplementedError) as error:
        # Pseudo-terminals and some adapters refuse; doctor reports what the timer is.
        _logger.debug("%s: low latency mode not available: %s", path, error)
    return port


def explain_open_error(path: str, error: OSError | ValueError) -> DeviceError:
    """Turn the library's error into one that names the cause and the remedy."""
    code = error.errno if isinstance(error, OSError) else None
    text = str(error)
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO):
        return _absent(path, gone=code != errno.ENOENT)
    if code in (errno.EACCES, errno.EPERM):
        return DeviceError(
            f"force sensor: no permission to open {path}",
            remedy="sudo usermod -aG dialout $USER, then log out and in again",
        )
    if code == errno.EBUSY or "exclusively lock" in text:
        return _in_use(path, [])
    return DeviceError(
        f"force sensor: {path} cannot be used as a serial port: {text}",
        remedy="set force_sensor.port to the adapter's path below /dev/serial/by-id/",
    )


def is_pseudo_terminal(path: str) -> bool:
    """Return whether a program, and no adapter, is behind ``path``."""
    return os.path.realpath(path).startswith("/dev/pts/")


def adapter_serial(path: str) -> str:
    """Return the USB serial number of the adapter behind ``path``, or an empty text."""
    target = os.path.realpath(path)
    for entry in list_ports.comports():
        if os.path.realpath(entry.device) == target:
            return str(entry.serial_number or "")
    return ""


def _absent(path: str, *, gone: bool) -> DeviceError:
    found = ", ".join(sorted(str(entry) for entry in Path("/dev/serial/by-id").glob("*")))
    what = "is there but nothing is behind it" if gone else "does not exist"
    return DeviceError(
        f"force sensor: the port {path} {what}",
        remedy="check the USB cable and the box's power; ports present now: "
        + (found or "none below /dev/serial/by-id"),
    )


def _in_use(path: str, holders: list[str]) -> DeviceError:
    who = ", ".join(holders) or "another program"
    return DeviceError(
        f"force sensor: {path} is in use by {who}",
        remedy=f"end that program; `fuser -v {path}` names it",
    )
