"""What a press is doing, in words."""

from __future__ import annotations

from tacauchy_rig.app.cli.progress import PHASES
from tacauchy_rig.core.run import Phase


def test_every_phase_has_words() -> None:
    """An operator reads no name of the program's."""
    assert set(PHASES) == {phase.value for phase in Phase}
    assert all(" " in words or words == "judging" for words in PHASES.values())
