"""The cases of the fault table: what goes wrong, and when."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from fnmatch import fnmatch

from drivers.device.faults import FAULTS_OF_DEVICE, Device, Fault, FaultKind
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.run import Phase


class Moment(StrEnum):
    """When it goes wrong."""

    SEARCH = "search"
    PRESS = "press"
    DWELL = "dwell"

    @property
    def phase(self) -> Phase:
        """Phase of the trial."""
        return Phase(self.value)

    @property
    def delay_s(self) -> float:
        """From the phase's begin [s]: just before the gel; on the way down; holding."""
        return {Moment.SEARCH: 2.0, Moment.PRESS: 0.5, Moment.DWELL: 0.4}[self]


class Victim(StrEnum):
    """Processes of a run that can be killed."""

    SUPERVISOR = "supervisor"
    CONTROL = "control"
    CAMERA = "camera"
    RECORDER = "recorder"


@dataclass(frozen=True, slots=True)
class FaultCase:
    """One row of the table.

    Attributes:
        cause: A device fails, or a process is killed as by the kernel when memory runs out.
    """

    cause: Fault | Victim
    moment: Moment

    @property
    def cause_name(self) -> str:
        """What goes wrong, without the moment."""
        if isinstance(self.cause, Victim):
            return f"kill:{self.cause.value}"
        return f"{self.cause.device.value}:{self.cause.kind.value}"

    @property
    def name(self) -> str:
        """Text that ``--only`` matches."""
        return f"{self.cause_name}@{self.moment.value}"

    @property
    def slug(self) -> str:
        """Name of the case's folder."""
        return self.name.replace(":", "-").replace("@", "-")


def all_cases() -> tuple[FaultCase, ...]:
    """Return every fault that an emulator knows and every process, at every moment."""
    causes: list[Fault | Victim] = [
        Fault(device=device, kind=kind)
        for device in Device
        for kind in FaultKind
        if kind in FAULTS_OF_DEVICE[device] - {FaultKind.UNLOCK}
    ]
    causes += Victim
    return tuple(FaultCase(cause, moment) for cause in causes for moment in Moment)


def select_cases(
    cases: Sequence[FaultCase], *, only: Sequence[str] = (), moments: Sequence[Moment] = ()
) -> tuple[FaultCase, ...]:
    """Return the cases whose name matches any pattern of ``only``, at any of ``moments``.

    Args:
        cases: What to choose from.
        only: Shell patterns of names, or of the part before the ``@``; empty for all.
        moments: Empty for all.

    Raises:
        ConfigError: A pattern matches no case.
    """
    possible = tuple(case for case in cases if not moments or case.moment in moments)
    for pattern in only:
        if not any(_matches(case, pattern) for case in possible):
            when = f" at {', '.join(moments)}" if moments else ""
            raise ConfigError(
                f"--only {pattern!r} matches no case{when}",
                remedy="`tacauchy-rig fault-table --list` names all of them",
            )
    return tuple(
        case for case in possible if not only or any(_matches(case, pattern) for pattern in only)
    )


def _matches(case: FaultCase, pattern: str) -> bool:
    return fnmatch(case.name, pattern) or fnmatch(case.cause_name, pattern)
