"""What is known of a run that others recorded: ``imported.json``. All values are SI."""

from __future__ import annotations

from dataclasses import dataclass, field

SAME_PLACE_M = 3e-5
"""Presses nearer to each other are at one place: half a pixel of a GelSight Mini."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedTrial:
    """One press of theirs.

    Attributes:
        name: What the source calls it.
        place_m: Where the indenter's tip came down beside the pad's centre [m]; None: not known.
        indenter: As ``press --indenter`` has it; empty is the run's.
        streams: Those of ``force``, ``image`` and ``arm`` that its recording has.
        contact_px: Column, row and radius of the contact's edge as somebody drew it into the
            image, in its own pixels [px]; None where nobody did.
        image: What the source calls its last image; empty where it has none.
    """

    index: int
    name: str
    place_m: tuple[float, float] | None = None
    indenter: str = ""
    streams: tuple[str, ...] = ()
    contact_px: tuple[float, float, float] | None = None
    image: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraClock:
    """How images were aligned in time with the force.

    Attributes:
        offset_s: Added to a camera's time for the log's own time [s].
        uncertainty_s: Its standard uncertainty [s].
        correlation: Of what is seen with what is felt, with this offset.
    """

    offset_s: float
    uncertainty_s: float
    correlation: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """Where an imported run is from.

    Attributes:
        kind: Its format, such as ``csv``.
        source: Name of the folder or file.
        has_clock: Samples have times of theirs; without, stamps give the order only.
        unknown: What the source does not say, a sentence each.
        notes: What was made of it, a sentence each: losses, and how presses were found.
        files: SHA-256 of what was read, by the name within the source.
        clock: None where no camera's clock was aligned.
    """

    kind: str
    source: str
    has_clock: bool
    unknown: tuple[str, ...]
    notes: tuple[str, ...]
    trials: tuple[ImportedTrial, ...]
    files: dict[str, str] = field(default_factory=dict)
    clock: CameraClock | None = None
