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


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceFault:
    """A device fails."""

    device: Device
    kind: FaultKind

    def __str__(self) -> str:
        return f"{self.device.value}:{self.kind.value}"

    @property
    def fault(self) -> Fault:
        """What to tell the emulator."""
        return Fault(device=self.device, kind=self.kind)


@dataclass(frozen=True, slots=True)
class Kill:
    """A process of the run is killed, as by the kernel when memory runs out."""

    victim: Victim

    def __str__(self) -> str:
        return f"kill:{self.victim.value}"


@dataclass(frozen=True, slots=True)
class FaultCase:
    """One row of the table."""

    cause: DeviceFault | Kill
    moment: Moment

    @property
    def name(self) -> str:
        """Text that ``--only`` matches."""
        return f"{self.cause}@{self.moment.value}"

    @property
    def slug(self) -> str:
        """Name of the case's folder."""
        return self.name.replace(":", "-").replace("@", "-")


def all_cases() -> tuple[FaultCase, ...]:
    """Return every fault that an emulator knows and every process, at every moment."""
    causes: list[DeviceFault | Kill] = [
        DeviceFault(device=device, kind=kind)
        for device in Device
        for kind in FaultKind
        if kind in FAULTS_OF_DEVICE[device]
    ]
    causes += [Kill(victim) for victim in Victim]
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
    return fnmatch(case.name, pattern) or fnmatch(str(case.cause), pattern)
