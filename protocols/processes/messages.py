"""What the processes of a run say to one another."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, auto
from pathlib import Path

from drivers.device.interface import DeviceIdentity, StreamHealth
from drivers.rig import FrameMark
from protocols.trials.trial import PlannedTrial
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.expected_press import ExpectedPress


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactOutline:
    """Where the indenter's contact should be seen in the camera's image.

    Attributes:
        image_size_px: Width and height of the camera's frames.
        centre_px: Where the indenter comes down, from the left and from the top.
        scale_px_m: Pixels to a metre, along and across.
        flat_radius_m: Of a flat face; 0 for a ball.
        ball_radius_m: Of a ball; 0 for a flat face.
    """

    image_size_px: tuple[int, int]
    centre_px: tuple[float, float]
    scale_px_m: tuple[float, float]
    flat_radius_m: float = 0.0
    ball_radius_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PageWish:
    """That an operator's page is wanted.

    Attributes:
        port: Of the loopback address; 0 takes a free one.
        outline: Expected contact in the image; None where nobody knows.
    """

    port: int = 0
    outline: ContactOutline | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerWish:
    """That a viewer from outside of ``protocols`` is wanted; the page shows what it shows.

    Attributes:
        name: One of ``feed.VIEWERS``.
        module: What its process runs, by ``python -m``.
        options: What it has to know beside the job.
        sources: Other viewers that it is shown, where they are wanted too.
    """

    name: str
    module: str
    options: dict[str, str] = field(default_factory=dict)
    sources: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PageJob:
    """What the page's process has to know.

    Attributes:
        token: First part of every path; whoever has it sees the run and can stop it.
    """

    token: str
    outline: ContactOutline | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """What a child is to do: its first message from the supervisor.

    Attributes:
        descriptors: Sockets that the child inherited, by what they lead to.
        expected: What a press should give; None where nobody knows.
        page: What the operator's page has to know; None for every other process.
        again: Whether an earlier process had begun it in this session.
        options: What a viewer from outside was wished with; empty for every other process.
    """

    root: Path
    config: RigConfig
    plan: tuple[PlannedTrial, ...]
    descriptors: dict[str, int]
    expected: ExpectedPress | None = None
    page: PageJob | None = None
    again: bool = False
    options: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ready:
    """A child has connected its devices."""

    devices: dict[str, DeviceIdentity]


@dataclass(frozen=True, slots=True, kw_only=True)
class Failed:
    """A child cannot go on."""

    message: str
    remedy: str
    exit_code: int = 2

    @classmethod
    def because(cls, error: RigError) -> Failed:
        """Return what to tell of ``error``."""
        return cls(message=error.message, remedy=error.remedy, exit_code=error.exit_code)


class Order(Enum):
    """What the supervisor tells its children: begin, finish what is begun and end, or "I live"."""

    GO = auto()
    STOP = auto()
    ALIVE = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class AbortRequest:
    """A person wants the arm to stop."""

    reason: str


@dataclass(frozen=True, slots=True)
class Kept:
    """How many samples, frames and events of this producer the recorder has acknowledged."""

    count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraStatus:
    """What the camera process tells control: marks of new frames, and how the stream does."""

    marks: tuple[FrameMark, ...]
    health: StreamHealth


@dataclass(frozen=True, slots=True, kw_only=True)
class Ack:
    """The recorder has everything up to entry ``through`` on disk.

    Attributes:
        kept_count: Samples, frames and events of this producer that are in recordings.
        trial: Attempt that is being recorded; 0 between attempts.
    """

    through: int
    kept_count: int
    trial: int
    attempt: int
