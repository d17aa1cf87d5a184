"""Is there room for the recording, and does the disk keep up with it?"""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from tacauchy_rig.core.check_result import CheckResult, CheckStatus, failed, passed
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import RecordError, RigError
from tacauchy_rig.core.store.durable import free_bytes
from tacauchy_rig.core.store.free_space import check_free_space, estimate_session

_BLOCK_BYTES = 1 << 20
_SYNC_INTERVAL_S = 0.25
_LIMIT_BYTES = 512 << 20
_COMFORTABLE = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DiskRate:
    """How fast a file grew while it was forced to the disk several times a second.

    Attributes:
        rate_bytes_s: Bytes written over the time they took, syncs included [bytes/s].
        slowest_sync_s: The longest of the syncs [s].
    """

    rate_bytes_s: float
    slowest_sync_s: float


def disk_checks(config: RigConfig) -> list[CheckResult]:
    """Return ``disk.space`` and ``disk.rate`` for the configured output directory."""
    folder = Path(config.run.output_directory)
    checks = (("disk.space", _space_check), ("disk.rate", _rate_check))
    results = []
    for name, check in checks:
        try:
            results.append(check(name, folder, config))
        except RigError as error:
            results.append(failed(name, error))
    return results


def measure_disk(folder: Path, *, duration_s: float = 1.0) -> DiskRate:
    """Write incompressible data beside ``folder`` for ``duration_s`` [s] and remove it again.

    Raises:
        RecordError: Nothing can be written there.
    """
    existing = folder.absolute()
    while not existing.is_dir() and existing != existing.parent:
        existing = existing.parent
    block = os.urandom(_BLOCK_BYTES)
    try:
        with tempfile.TemporaryFile(dir=existing, buffering=0) as file:
            return _write_for(file.fileno(), block, duration_s)
    except OSError as error:
        raise RecordError(
            f"{existing}: cannot be written: {error.strerror or error}",
            remedy="set run.output_directory to a folder of yours with free space",
        ) from error


def _write_for(descriptor: int, block: bytes, duration_s: float) -> DiskRate:
    written = 0
    slowest_s = 0.0
    started = synced = time.monotonic()
    while time.monotonic() < started + duration_s and written < _LIMIT_BYTES:
        written += os.write(descriptor, block)
        if time.monotonic() - synced >= _SYNC_INTERVAL_S:
            slowest_s = max(slowest_s, _sync(descriptor))
            synced = time.monotonic()
    slowest_s = max(slowest_s, _sync(descriptor))
    return DiskRate(rate_bytes_s=written / (time.monotonic() - started), slowest_sync_s=slowest_s)


def _sync(descriptor: int) -> float:
    started = time.monotonic()
    os.fsync(descriptor)
    return time.monotonic() - started


def _space_check(name: str, folder: Path, config: RigConfig) -> CheckResult:
    needed = check_free_space(folder, config).total_bytes
    free = free_bytes(folder)
    finding = f"{free / 1e9:.1f} GB free at {folder}, {needed / 1e9:.1f} GB needed at most"
    return passed(name, finding, value=free / 1e9, unit="GB")


def _rate_check(name: str, folder: Path, config: RigConfig) -> CheckResult:
    needed = estimate_session(config).rate_bytes_s
    measured = measure_disk(folder)
    finding = (
        f"{measured.rate_bytes_s / 1e6:.0f} MB/s written and synced, slowest sync "
        f"{measured.slowest_sync_s * 1e3:.0f} ms; recording needs {needed / 1e6:.1f} MB/s"
    )
    ratio = measured.rate_bytes_s / needed
    status = CheckStatus.OK
    if ratio < _COMFORTABLE:
        status = CheckStatus.WARN if ratio >= 1.0 else CheckStatus.FAIL
    return CheckResult(
        name=name,
        status=status,
        finding=finding,
        value=measured.rate_bytes_s / 1e6,
        unit="MB/s",
        remedy=""
        if status is CheckStatus.OK
        else "set run.output_directory to a faster disk, or "
        "lower camera.width, camera.height or camera.rate",
    )
