"""``tacauchy-rig study verify``: the simulator against what others found."""

from __future__ import annotations

from tacauchy_rig.app.cli.study_command import study_command
from tacauchy_rig.core.study import Study


@study_command
def verify() -> Study:
    """Press what has a known answer, and say how far off the simulator is; takes minutes.

    Example: tacauchy-rig study verify --only punch --only hertz
    """
    from sim.studies.verification.study import Verification

    return Verification()
