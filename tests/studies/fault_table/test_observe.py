"""One case for real: the program, its processes, ur_rtde, pyserial and OpenCV.

A session's own tests kill its processes.
"""

import pytest

from drivers.emulators.faults import Device, Fault, FaultKind
from tests.studies.fault_table.cases import FaultCase, Moment
from tests.studies.fault_table.observe import observe_case


@pytest.mark.timeout(400)
def test_a_case_ends_without_motion_hang_or_loss(tmp_path):
    """Unplugged, the arm stands, all that was acknowledged is readable, and resume finishes."""
    unplugged = Fault(device=Device.FORCE_SENSOR, kind=FaultKind.UNPLUG)
    seen = observe_case(FaultCase(unplugged, Moment.DWELL), tmp_path / "case")
    assert seen.problems == ()
    assert seen.exit_code == 2
    assert seen.arm.stopped_after_s is not None
    assert sum(seen.kept.acknowledged.values()) > 100
    assert seen.resumed[-1].exit_code == 0
