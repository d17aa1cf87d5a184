"""``tacauchy-rig study hard-cases``: what a simulator breaks on, measured."""

from __future__ import annotations

from tacauchy_rig.app.cli.study_command import study_command
from tacauchy_rig.core.study import Study


@study_command
def hard_cases() -> Study:
    """Measure the simulator's hard cases, each in a process of its own.

    Example: tacauchy-rig study hard-cases --only 1 --only 14
    """
    from sim.studies.hard_cases.study import HardCases

    return HardCases()
