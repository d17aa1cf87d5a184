"""The cases of the fault table: what goes wrong, and when."""

import os
import socket
import subprocess
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from enum import StrEnum
from importlib import resources
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

from drivers.emulators.faults import FAULTS_OF_DEVICE, SILENT_FORCE_FAULTS, Device, Fault, FaultKind
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import Phase
from tacauchy_rig.core.study import selected

CONNECTIONS = 200
SLOW_CLIENTS = 30
_SMALL_BUFFER_BYTES = 2048
_TIMEOUT_S = 5.0


class Crowd(StrEnum):
    """What they do."""

    FLOOD = "flood"
    SLOW_CLIENT = "slow-client"


class Visitors:
    """Connections to a page that stay open until this is closed."""

    def __init__(self, address: str) -> None:
        self._address = urlsplit(address)
        self._open = ExitStack()

    def come(self, crowd: Crowd) -> Self:
        """Open every connection: half of a flood asks for events, slow clients read nothing."""
        if crowd is Crowd.FLOOD:
            for number in range(CONNECTIONS):
                self._visit("events" if number % 2 else "", buffer_bytes=None)
        else:
            for number in range(SLOW_CLIENTS):
                path = "events" if number % 2 else "picture/camera"
                self._visit(path, buffer_bytes=_SMALL_BUFFER_BYTES)
        return self

    def close(self) -> None:
        """Close them."""
        self._open.close()

    def _visit(self, path: str, *, buffer_bytes: int | None) -> None:
        visit = self._open.enter_context(socket.socket())
        if buffer_bytes is not None:
            visit.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
        visit.settimeout(_TIMEOUT_S)
        visit.connect((self._address.hostname, self._address.port))
        if path:
            first = f"GET {self._address.path}{path} HTTP/1.1"
            visit.sendall(f"{first}\r\nHost: {self._address.netloc}\r\n\r\n".encode())


_SOURCE = "host_trouble.c"


class Trouble(StrEnum):
    """What the library knows: names of the files that switch it on."""

    CLOCK_BACK = "clock-back"
    CLOCK_FORWARD = "clock-forward"
    READ_ONLY = "read-only"
    DISK_FULL = "disk-full"
    DISK_SLOW = "slow-disk"


class HostTrouble:
    """Trouble that can be switched on and off while the program runs."""

    def __init__(self, folder: Path, *, disk: Path) -> None:
        folder.mkdir(exist_ok=True)
        self._folder, self._disk = folder, disk
        self._library = folder / "host_trouble.so"
        source = resources.files("tests.studies.fault_table").joinpath(_SOURCE).read_bytes()
        command = ["cc", "-O1", "-shared", "-fPIC", "-o", str(self._library), "-x", "c", "-"]
        try:
            subprocess.run(command, input=source, check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError) as error:
            said = getattr(error, "stderr", b"") or b""
            raise DeviceError(
                f"{_SOURCE} cannot be compiled: {error} {said.decode(errors='replace')}".strip(),
                remedy="install a C compiler that answers to `cc`, such as gcc",
            ) from error

    @property
    def environment(self) -> dict[str, str]:
        """Environment of a program that is to have the trouble."""
        return {
            **os.environ,
            "LD_PRELOAD": str(self._library),
            "HOST_TROUBLE": str(self._folder),
            "HOST_TROUBLE_DISK": str(self._disk),
        }

    def begin(self, trouble: Trouble) -> None:
        """Switch it on."""
        (self._folder / trouble.value).touch()

    def end(self) -> None:
        """Switch all of it off."""
        for trouble in Trouble:
            (self._folder / trouble.value).unlink(missing_ok=True)


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


TARGET_N = 2.0  # what a case presses to, unless it says otherwise [N]
DWELL_S = 1.2  # how long a case holds its force, unless it says otherwise: the default of a run [s]
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
    """One row of the table."""

    cause: Cause  # what fails: a device, a process of the run, the computer, or its users
    moment: Moment
    target_n: float = TARGET_N  # what the press is to reach [N]

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
        if kind in FAULTS_OF_DEVICE[device].keys() - {FaultKind.UNLOCK}
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
    """Return the cases whose name matches any pattern of ``only``, at any of ``moments``."""
    possible = tuple(case for case in cases if not moments or case.moment in moments)
    return selected(
        possible,
        only,
        names=lambda case: (case.name, case.cause_name),
        kind=f"case at {', '.join(moments)}" if moments else "case",
        remedy="`python -m tests.studies fault-table --list` names all of them",
    )
