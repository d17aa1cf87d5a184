"""Start Warp without its greeting, and without its complaint on machines that have no GPU."""

from __future__ import annotations

import ctypes.util
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

import warp as wp

from tacauchy_rig.errors import ConfigError

# For kernels on the processor that much time goes by: products and sums in one instruction. Warp's
# own flags add some that suit other kernels.
CPU_FLAGS = "-march=native -ffp-contract=fast"


def start_warp() -> None:
    """Initialise Warp; the native library reports a missing CUDA driver on file descriptor 2."""
    wp.config.log_level = wp.LOG_WARNING
    has_driver = ctypes.util.find_library("cuda") is not None
    with nullcontext() if has_driver else _silent_stderr():
        wp.init()  # type: ignore[no-untyped-call]


def warp_device(name: str) -> str:
    """Return a device's name if it is here.

    Raises:
        ConfigError: There is no such device.
    """
    start_warp()
    present = [device.alias for device in wp.get_devices()]
    if name not in present:
        raise ConfigError(
            f"device {name!r}: not on this machine",
            remedy=f"choose one of {', '.join(present)}; a GPU needs its NVIDIA driver",
        )
    return name


@contextmanager
def _silent_stderr() -> Iterator[None]:
    sys.stderr.flush()
    kept = os.dup(2)
    void = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(void, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(void)
