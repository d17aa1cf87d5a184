"""Checks of the computer itself: versions, clock, timer, cores, memory, groups, disk."""

from __future__ import annotations

import grp
import os
import platform
import resource
import sys
import time
from collections.abc import Callable, Sequence

import psutil

from tacauchy_rig.app.doctor.disk import disk_checks
from tacauchy_rig.core.check_result import CheckResult, CheckStatus, failed, judged, passed, skipped
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.versions import ABSENT, installed

PACKAGES = (
    "ur-rtde",
    "pyserial",
    "opencv-contrib-python-headless",
    "numpy",
    "scipy",
    "warp-lang",
    "mcap",
    "pydantic",
)
_MIN_CORES = 2
_MIN_MEMORY_BYTES = 4 * 2**30
_MIN_DESCRIPTORS = 64
"""The process that watches a run opens some 30 files, sockets and pipes."""
_MAX_CLOCK_STEP_S = 1e-5
_TIMER_PERIOD_S = 0.002
_TIMER_COUNT = 250
_MAX_LATENESS_S = 0.010


def host_checks(config: RigConfig) -> list[CheckResult]:
    """Return every check of this computer; takes about two seconds."""
    return [
        version_check(),
        clock_check(),
        timer_check(),
        core_check(len(os.sched_getaffinity(0))),
        memory_check(int(psutil.virtual_memory().available)),
        descriptor_check(resource.getrlimit(resource.RLIMIT_NOFILE)[0]),
        *group_checks(config, groups=own_groups(), user_id=os.geteuid()),
        *disk_checks(config),
    ]


def version_check(packages: Sequence[str] = PACKAGES) -> CheckResult:
    """Tell the versions that a record will name; fail where a package is missing."""
    found = installed(*packages)
    python = f"Python {found.pop('python')} on {platform.machine()}"
    missing = [package for package, version in found.items() if version == ABSENT]
    if missing or sys.version_info < (3, 11):
        return CheckResult(
            name="host.versions",
            status=CheckStatus.FAIL,
            finding=f"{python}; missing: {', '.join(missing) or 'nothing'}",
            remedy="Python 3.11 or newer is needed; install with `make setup` or `pip install .`",
        )
    listed = ", ".join(f"{package} {version}" for package, version in found.items())
    return passed("host.versions", f"{python}; {listed}")


def clock_check(now_ns: Callable[[], int] = time.monotonic_ns) -> CheckResult:
    """Measure the smallest step of the clock that stamps every stream."""
    steps = []
    last = now_ns()
    for _ in range(20_000):
        stamp = now_ns()
        if stamp != last:
            steps.append(stamp - last)
            last = stamp
    step_s = min(steps, default=10**9) * 1e-9
    finding = f"the monotonic clock moves in steps of {step_s * 1e6:.3f} us"
    return judged(
        "host.clock",
        finding,
        is_good=step_s <= _MAX_CLOCK_STEP_S,
        value=step_s * 1e6,
        unit="us",
        remedy="`cat /sys/devices/system/clocksource/clocksource0/current_clocksource` should "
        "say tsc",
    )


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
    return judged(
        "host.cores",
        f"{count} cores may be used" if is_good else few,
        is_good=is_good,
        value=count,
        unit="cores",
        remedy="give this computer, container or session at least two cores",
    )


def memory_check(available_bytes: int) -> CheckResult:
    """Judge the memory that is available."""
    gib = available_bytes / 2**30
    return judged(
        "host.memory",
        f"{gib:.1f} GiB of memory available",
        is_good=available_bytes >= _MIN_MEMORY_BYTES,
        value=gib,
        unit="GiB",
        remedy=f"end other programs; the replay wants {_MIN_MEMORY_BYTES / 2**30:.0f} GiB",
    )


def descriptor_check(limit: int) -> CheckResult:
    """Judge how many files this process may have open at once."""
    name = "host.descriptors"
    finding = f"{limit} files may be open at once"
    if limit >= _MIN_DESCRIPTORS or limit == resource.RLIM_INFINITY:
        return passed(name, finding, value=limit, unit="files")
    too_few = f"only {finding}; a run needs {_MIN_DESCRIPTORS}"
    return failed(name, RigError(too_few, remedy="`ulimit -n 1024` before the command admits more"))


def own_groups() -> frozenset[str]:
    """Return the names of the groups of this process."""
    names = {group.gr_gid: group.gr_name for group in grp.getgrall()}
    return frozenset(names.get(number, str(number)) for number in os.getgroups())


def group_checks(config: RigConfig, *, groups: frozenset[str], user_id: int) -> list[CheckResult]:
    """Judge whether this user may open serial ports and cameras, where real ones are used."""
    needed = {
        "dialout": config.force_sensor.driver == "m3733c",
        "video": config.camera.driver == "uvc",
    }
    return [_group_check(name, on, groups, user_id) for name, on in needed.items()]


def _group_check(group: str, needed: bool, groups: frozenset[str], user_id: int) -> CheckResult:
    name = f"host.group_{group}"
    if not needed:
        return skipped(name, "no real device needs it")
    if user_id == 0:
        return passed(name, "running as root: every device may be opened")
    is_in = group in groups
    return judged(
        name,
        f"this user is {'' if is_in else 'not '}in the group {group}",
        is_good=is_in,
        remedy=f"sudo usermod -aG {group} $USER, then log out and in again",
    )
