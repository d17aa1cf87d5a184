"""Errors shown to a person: each names the field, the value with its unit, and the remedy."""

import shlex
from collections.abc import Iterator
from contextlib import contextmanager


def command_line(*words: object) -> str:
    """Return a command of this program as a shell takes it, whatever a path holds."""
    return shlex.join(["tacauchy-rig", *map(str, words)])


class RigError(Exception):
    """Base of every error this project raises on purpose.

    Args:
        message: What is wrong: the device or field, and the value with its unit.
        remedy: What the reader can do about it; shown on a line of its own.
    """

    exit_code = 2

    def __init__(self, message: str, *, remedy: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.remedy = remedy

    def __str__(self) -> str:
        return f"{self.message}\n  -> {self.remedy}" if self.remedy else self.message


class ConfigError(RigError):
    """A configuration field is unknown, in the wrong unit, or outside its limits."""


class DeviceError(RigError):
    """A device is absent, silent, stale, or says something it must not say."""


class SafetyError(RigError):
    """A limit of the guard was passed; the arm has been told to stop."""


class ConvergenceError(RigError):
    """The simulator found no equilibrium; the last good state is named in the message."""


class TimeLimitError(RigError):
    """A computation did not end within the time that it was given."""


class RecordError(RigError):
    """A run folder or recording is missing, unfinished, damaged, or cannot be written."""


class AbortedError(RigError):
    """A person (key, Ctrl-C, SIGTERM, lost terminal) asked the run to end."""

    exit_code = 3


@contextmanager
def naming(origin: str) -> Iterator[None]:
    """Name a file in the message of what is refused within."""
    try:
        yield
    except RigError as error:
        raise type(error)(f"{origin}: {error.message}", remedy=error.remedy) from error


@contextmanager
def whole(name: str, kind: str, *, remedy: str = "copy it anew from its source") -> Iterator[None]:
    """Refuse by its name and kind what a library cannot read within, whatever it raises."""
    try:
        yield
    except RigError:
        raise
    except Exception as error:
        why = f"{type(error).__name__} {str(error)[:200]}".strip()
        raise RecordError(f"{name}: no whole {kind}: {why}", remedy=remedy) from error
