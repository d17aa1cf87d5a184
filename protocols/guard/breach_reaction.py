"""A limit that was passed, and what the arm may still do about it."""

from collections.abc import Iterable
from enum import StrEnum

from tacauchy_rig.core.errors import AbortedError, RigError, SafetyError


class Reaction(StrEnum):
    """What follows the stop, in order of severity.

    ``retract`` slowly, where robot and force sensor can still be trusted; ``hold`` where one of
    them cannot; ``protective-stop`` where the controller itself must lock the arm.
    """

    RETRACT = "retract"
    HOLD = "hold"
    PROTECTIVE_STOP = "protective-stop"


class BreachError(SafetyError):
    """A limit was passed: a configuration field, or the name of what failed."""

    def __init__(self, message: str, *, limit: str, reaction: Reaction, remedy: str) -> None:
        super().__init__(message, remedy=remedy)
        self.limit = limit
        self.reaction = reaction


def most_severe(breaches: Iterable[BreachError]) -> BreachError:
    """Return which of several limits, passed in one turn, decides the reaction."""
    severity = list(Reaction)
    return max(breaches, key=lambda breach: severity.index(breach.reaction))


def reaction_to(error: RigError) -> Reaction:
    """Return what may follow the stop: an abort retracts, an unforeseen refusal holds."""
    if isinstance(error, BreachError):
        return error.reaction
    return Reaction.RETRACT if isinstance(error, AbortedError) else Reaction.HOLD
