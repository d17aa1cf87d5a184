"""The sections by name."""

from __future__ import annotations

from sim.studies.verification.study import SECTIONS


def test_every_section_of_the_catalogue_has_a_name_of_the_command_line() -> None:
    """Names are what ``--only`` takes: lower case and hyphens."""
    assert all(name.replace("-", "").isalpha() and name == name.lower() for name in SECTIONS)
