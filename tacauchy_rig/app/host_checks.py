"""Checks of the computer itself: versions, timer, cores, memory, groups, disk."""

import grp
import os
import resource
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import psutil

from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.doctor_check import CheckResult, CheckStatus, failed, judged, passed, skipped
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.store.atomic_write import existing_folder, free_bytes, writing
from tacauchy_rig.core.store.free_space import check_free_space, estimate_session
from tacauchy_rig.core.versions import ABSENT, installed, versions

_BLOCK_BYTES = 1 << 20
_SYNC_INTERVAL_S = 0.25
_LIMIT_BYTES = 512 << 20
_COMFORTABLE = 3.0


def disk_checks(config: RigConfig) -> list[CheckResult]:
    """Return ``disk.space`` and ``disk.rate`` for the configured output directory."""
    results = []
    for name, check in (("disk.space", _space_check), ("disk.rate", _rate_check)):
        try:
            results.append(check(name, Path(config.run.output_directory), config))
        except RigError as error:
            results.append(failed(name, error))
    return results


def measure_disk(folder: Path, *, duration_s: float = 1.0) -> tuple[float, float]:
    """Write incompressible data beside ``folder`` for ``duration_s`` [s] and remove it again.

    Returns:
        Bytes over the time they took, syncs included [bytes/s], and the longest sync [s].
    """
    existing, block = existing_folder(folder), os.urandom(_BLOCK_BYTES)
    written, slowest_s = 0, 0.0
    with writing(existing), tempfile.TemporaryFile(dir=existing, buffering=0) as file:
        started = now = time.monotonic()
        while now < started + duration_s and written < _LIMIT_BYTES:
            synced = now
            while now < synced + _SYNC_INTERVAL_S and written < _LIMIT_BYTES:
                written += file.write(block)
                now = time.monotonic()
            os.fsync(file.fileno())
            slowest_s = max(slowest_s, time.monotonic() - now)
            now = time.monotonic()
        return written / (now - started), slowest_s


def _space_check(name: str, folder: Path, config: RigConfig) -> CheckResult:
    needed = check_free_space(folder, config).total_bytes
    free = free_bytes(folder)
    finding = f"{free / 1e9:.1f} GB free at {folder}, {needed / 1e9:.1f} GB needed at most"
    return passed(name, finding, value=free / 1e9, unit="GB")


def _rate_check(name: str, folder: Path, config: RigConfig) -> CheckResult:
    needed = estimate_session(config).rate_bytes_s
    rate, slowest_s = measure_disk(folder)
    finding = (
        f"{rate / 1e6:.0f} MB/s written and synced, slowest sync {slowest_s * 1e3:.0f} ms; "
        f"recording needs {needed / 1e6:.1f} MB/s"
    )
    ratio = rate / needed
    found = judged(
        name,
        finding,
        is_good=ratio >= _COMFORTABLE,
        value=rate / 1e6,
        unit="MB/s",
        remedy="set run.output_directory to a faster disk, or "
        "lower camera.width, camera.height or camera.rate",
    )
    return found if ratio >= 1.0 else replace(found, status=CheckStatus.FAIL)


_CLIENTS = ("ur-rtde", "pyserial")  # what else is missing stops the program before
_INSTALL = "install with `make setup` or `pip install .`"
_MIN_CORES = 2
_MIN_MEMORY_BYTES = 4 * 2**30
_MIN_DESCRIPTORS = 64
"""The process that watches a run opens some 30 files, sockets and pipes."""
_TIMER_PERIOD_S = 0.002
_TIMER_COUNT = 250
_MAX_LATENESS_S = 0.010


def host_checks(config: RigConfig) -> list[CheckResult]:
    """Return every check of this computer; takes about two seconds."""
    names = {group.gr_gid: group.gr_name for group in grp.getgrall()}
    groups = frozenset(names.get(number, str(number)) for number in os.getgroups())
    return [
        version_check(),
        timer_check(),
        core_check(len(os.sched_getaffinity(0))),
        memory_check(int(psutil.virtual_memory().available)),
        descriptor_check(resource.getrlimit(resource.RLIMIT_NOFILE)[0]),
        *group_checks(config, groups=groups, user_id=os.geteuid()),
        *disk_checks(config),
    ]


def version_check(clients: Sequence[str] = _CLIENTS) -> CheckResult:
    """Tell the versions that a record will name; fail where a client of devices is missing."""
    listed = ", ".join(f"{name} {version}" for name, version in versions().items())
    missing = [name for name, version in installed(*clients).items() if version == ABSENT]
    if missing:
        error = RigError(f"{listed}; missing: {', '.join(missing)}", remedy=_INSTALL)
        return failed("host.versions", error)
    return passed("host.versions", listed)


def timer_check() -> CheckResult:
    """Measure how late this process wakes up from short sleeps."""
    lateness = []
    for _ in range(_TIMER_COUNT):
        started = time.monotonic()
        time.sleep(_TIMER_PERIOD_S)
        lateness.append(time.monotonic() - started - _TIMER_PERIOD_S)
    worst_s, median_s = max(lateness), sorted(lateness)[_TIMER_COUNT // 2]
    finding = (
        f"wakes {median_s * 1e3:.2f} ms late (median of {_TIMER_COUNT} sleeps), "
        f"at worst {worst_s * 1e3:.1f} ms"
    )
    return judged(
        "host.timer",
        finding,
        is_good=worst_s <= _MAX_LATENESS_S,
        value=worst_s * 1e3,
        unit="ms",
        remedy="end other programs while pressing, and set the CPU governor to performance",
    )


def core_check(count: int) -> CheckResult:
    """Judge the number of cores that this process may use."""
    is_good = count >= _MIN_CORES
    few = f"{count} core may be used; control and camera want one each"
    finding = f"{count} cores may be used" if is_good else few
    remedy = "give this computer, container or session at least two cores"
    return judged("host.cores", finding, is_good=is_good, value=count, unit="cores", remedy=remedy)


def memory_check(available_bytes: int) -> CheckResult:
    """Judge the memory that is available."""
    gib, least_gib = available_bytes / 2**30, _MIN_MEMORY_BYTES / 2**30
    finding = f"{gib:.1f} GiB of memory available"
    remedy = f"end other programs; the replay wants {least_gib:.0f} GiB"
    return judged(
        "host.memory", finding, is_good=gib >= least_gib, value=gib, unit="GiB", remedy=remedy
    )


def descriptor_check(limit: int) -> CheckResult:
    """Judge how many files this process may have open at once."""
    name = "host.descriptors"
    finding = f"{limit} files may be open at once"
    if limit >= _MIN_DESCRIPTORS or limit == resource.RLIM_INFINITY:
        return passed(name, finding, value=limit, unit="files")
    too_few = f"only {finding}; a run needs {_MIN_DESCRIPTORS}"
    return failed(name, RigError(too_few, remedy="`ulimit -n 1024` before the command admits more"))


def group_checks(config: RigConfig, *, groups: frozenset[str], user_id: int) -> list[CheckResult]:
    """Judge whether this user may open serial ports and cameras, where real ones are used."""
    needed = {"dialout": config.force_sensor.is_real, "video": config.camera.is_real}
    results = []
    for group, is_needed in needed.items():
        name, is_in = f"host.group_{group}", group in groups
        finding = f"this user is {'' if is_in else 'not '}in the group {group}"
        remedy = f"sudo usermod -aG {group} $USER, then log out and in again"
        if not is_needed:
            results.append(skipped(name, "no real device needs it"))
        elif user_id == 0:
            results.append(passed(name, "running as root: every device may be opened"))
        else:
            results.append(judged(name, finding, is_good=is_in, remedy=remedy))
    return results
