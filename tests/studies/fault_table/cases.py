"""The cases of the fault table: what goes wrong, and when."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from drivers.emulators.faults import FAULTS_OF_DEVICE, SILENT_FORCE_FAULTS, Device, Fault, FaultKind
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.run import Phase
from tacauchy_rig.core.selection import selected
from tests.studies.fault_table.crowd import Crowd
from tests.studies.fault_table.host import Trouble


class Moment(StrEnum):
    """When it goes wrong."""

    START = "start"
    SEARCH = "search"
    PRESS = "press"
    DWELL = "dwell"

    @property
    def phase(self) -> Phase:
        """Phase of the trial; what was wrong from the start shows in the search first."""
        return Phase.SEARCH if self is Moment.START else Phase(self.value)

    @property
    def delay_s(self) -> float:
        """From the phase's begin [s]: under way; just before the gel; on the way down; holding."""
        return {Moment.START: 1.0, Moment.SEARCH: 2.0, Moment.PRESS: 0.5, Moment.DWELL: 0.4}[self]


TARGET_N = 2.0
"""What a case presses to, unless it says otherwise [N]."""
DWELL_S = 1.2
"""How long a case holds its force, unless it says otherwise: the default of a run [s]."""
RIVAL_DWELL_S = 20.0
"""How long where a second run is to find the first one at work: it needs seconds to begin [s]."""
LATER_MOMENTS = (Moment.SEARCH, Moment.PRESS, Moment.DWELL)


class Victim(StrEnum):
    """Processes of a run that can be killed, stopped, or get no more memory."""

    SUPERVISOR = "supervisor"
    CONTROL = "control"
    CAMERA = "camera"
    RECORDER = "recorder"
    PAGE = "page"


class BlowKind(StrEnum):
    """What is done to a process of the run: killed, stopped, or refused any more memory."""

    KILL = "kill"
    HANG = "hang"
    MEMORY = "memory"


@dataclass(frozen=True, slots=True)
class Blow:
    """Something done to one process of the run."""

    kind: BlowKind
    victim: Victim


class Rival(StrEnum):
    """Somebody else who wants the same devices."""

    SECOND_RUN = "second-run"


Cause = Fault | Blow | Trouble | Rival | Crowd


@dataclass(frozen=True, slots=True)
class FaultCase:
    """One row of the table.

    Attributes:
        cause: What fails: a device, a process of the run, the computer, or its users.
        target_n: What the press is to reach [N].
    """

    cause: Cause
    moment: Moment
    target_n: float = TARGET_N

    @property
    def cause_name(self) -> str:
        """What goes wrong, without the moment."""
        match self.cause:
            case Fault(device=device, kind=kind):
                return f"{device.value}:{kind.value}"
            case Blow(kind=blow, victim=victim):
                return f"{blow.value}:{victim.value}"
            case Crowd():
                return f"page:{self.cause.value}"
            case Trouble() | Rival():
                return f"host:{self.cause.value}"

    @property
    def name(self) -> str:
        """Text that ``--only`` matches."""
        target = "" if self.target_n == TARGET_N else f"-{self.target_n:g}N"
        return f"{self.cause_name}@{self.moment.value}{target}"

    @property
    def dwell_s(self) -> float:
        """How long the press holds its force [s]."""
        return RIVAL_DWELL_S if isinstance(self.cause, Rival) else DWELL_S

    @property
    def slug(self) -> str:
        """Name of the case's folder."""
        return self.name.replace(":", "-").replace("@", "-")


def all_cases() -> tuple[FaultCase, ...]:
    """Return every fault of emulators, processes and computer at the three later moments.

    A force sensor that lies does so also from the start, at each target of the protocol.
    """
    causes: list[Cause] = [
        Fault(device=device, kind=kind)
        for device in Device
        for kind in FaultKind
        if kind in FAULTS_OF_DEVICE[device] - {FaultKind.UNLOCK}
    ]
    deadly = (BlowKind.KILL, BlowKind.MEMORY)
    causes += [Blow(kind, victim) for kind in deadly for victim in Victim]
    causes += [Blow(BlowKind.HANG, Victim.PAGE), *Crowd, *Trouble, *Rival]
    targets_n = load_config().config.protocol.force_targets
    return tuple(
        case
        for cause in causes
        for case in (
            *(FaultCase(cause, moment) for moment in LATER_MOMENTS),
            *(FaultCase(cause, Moment.START, target_n) for target_n in _asked(cause, targets_n)),
        )
    )


def _asked(cause: Cause, targets_n: Sequence[float]) -> Sequence[float]:
    lies = isinstance(cause, Fault) and cause.kind in SILENT_FORCE_FAULTS
    return targets_n if lies else ()


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
    return selected(
        possible,
        only,
        names=lambda case: (case.name, case.cause_name),
        kind=f"case at {', '.join(moments)}" if moments else "case",
        remedy="`python -m tests.studies fault-table --list` names all of them",
    )
