"""Every case of the tampering table, in its order."""

from __future__ import annotations

from tacauchy_rig.tampering.case import TamperCase
from tacauchy_rig.tampering.recordings import recording_cases
from tacauchy_rig.tampering.results import journal_cases, replay_cases, result_cases


def all_cases() -> tuple[TamperCase, ...]:
    """Return the cases."""
    return (*recording_cases(), *result_cases(), *journal_cases(), *replay_cases())
