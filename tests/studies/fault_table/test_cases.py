"""Which cases the fault table has."""

from drivers.emulators.faults import FAULTS_OF_DEVICE
from tests.studies.fault_table.cases import Crowd, Moment, Rival, Trouble, Victim, all_cases


def test_every_fault_and_every_process_is_there_at_every_moment():
    """Nothing that an emulator can be told to do is left out."""
    cases = all_cases()
    fault_count = sum(len(kinds) for kinds in FAULTS_OF_DEVICE.values()) - 1  # unlocking mends
    others = 2 * len(Victim) + 1 + len(Trouble) + len(Rival) + len(Crowd)  # one process hangs
    later = [case for case in cases if case.moment is not Moment.START]
    assert len(later) == (fault_count + others) * 3
    assert len({case.slug for case in cases}) == len(cases)
