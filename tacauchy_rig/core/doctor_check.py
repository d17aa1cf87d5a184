"""What one check of ``doctor`` found."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

from tacauchy_rig.core.errors import RigError


class CheckStatus(StrEnum):
    """How a check ended; only ``fail`` keeps a run from starting."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"
    SKIP = "skip"


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckResult:
    """One line of ``doctor``."""

    name: str  # part and property, such as ``disk.rate``
    status: CheckStatus
    finding: str  # what was found, in words, numbers with their unit
    value: float | None = None  # the number that decided, in ``unit``; None where there is none
    unit: str = ""
    remedy: str = ""  # what to do, unless the status is ok


def passed(name: str, finding: str, *, value: float | None = None, unit: str = "") -> CheckResult:
    """Return a check that found nothing wrong."""
    return CheckResult(name=name, status=CheckStatus.OK, finding=finding, value=value, unit=unit)


def judged(
    name: str,
    finding: str,
    *,
    is_good: bool,
    remedy: str,
    value: float | None = None,
    unit: str = "",
) -> CheckResult:
    """Return a check that warns, and says what to do, unless what was found is good."""
    found = passed(name, finding, value=value, unit=unit)
    return found if is_good else replace(found, status=CheckStatus.WARN, remedy=remedy)


def skipped(name: str, reason: str) -> CheckResult:
    """Return a check that had nothing to look at."""
    return CheckResult(name=name, status=CheckStatus.SKIP, finding=reason)


def failed(name: str, error: RigError) -> CheckResult:
    """Return a check that ended in an error that knows its remedy."""
    return CheckResult(
        name=name, status=CheckStatus.FAIL, finding=error.message, remedy=error.remedy
    )


def checked(name: str, check: Callable[[], str]) -> CheckResult:
    """Return a check that raises where it fails and otherwise returns its finding."""
    try:
        return passed(name, check())
    except RigError as error:
        return failed(name, error)
