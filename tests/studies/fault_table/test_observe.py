"""One case for real: the program, its processes, ur_rtde, pyserial, OpenCV and kill -9."""

from __future__ import annotations

import pytest

from drivers.emulators.faults import Device, Fault, FaultKind
from tests.studies.fault_table.cases import Blow, BlowKind, FaultCase, Moment, Victim
from tests.studies.fault_table.observe import observe_case

CASES = [
    FaultCase(Blow(BlowKind.KILL, Victim.RECORDER), Moment.PRESS),
    FaultCase(Fault(device=Device.FORCE_SENSOR, kind=FaultKind.UNPLUG), Moment.DWELL),
]


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_case_ends_without_motion_hang_or_loss(tmp_path, case):
    """The arm stands, every acknowledged message is readable, resume finishes the session."""
    seen = observe_case(case, tmp_path / case.slug)
    assert seen.problems == ()
    assert seen.exit_code == 2
    assert seen.arm.stopped_after_s is not None
    assert sum(seen.kept.acknowledged.values()) > 100
    assert seen.resumed[-1].exit_code == 0
