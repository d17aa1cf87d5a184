"""Every case of the tampering table, in its order."""

from __future__ import annotations

from tests.studies.tampering.case import TamperCase
from tests.studies.tampering.recordings import recording_cases
from tests.studies.tampering.results import journal_cases, replay_cases, result_cases


def all_cases() -> tuple[TamperCase, ...]:
    """Return the cases."""
    return (*recording_cases(), *result_cases(), *journal_cases(), *replay_cases())
