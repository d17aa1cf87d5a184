"""A whole session: from a run folder and a configuration to six kept trials."""

from __future__ import annotations

from collections.abc import Callable

from drivers.interfaces import Arm, Camera, Clock, ForceTorqueSensor
from drivers.rig import Rig
from protocols.cycle import Cycle
from protocols.direct_sink import DirectCamera, DirectSink
from protocols.guard.abort import Abort
from protocols.journal import Journal
from protocols.processes.supervisor import SessionResult, Supervisor
from protocols.programme import PlannedTrial, ProgrammeResult, fresh_plan, run_programme
from protocols.record_keeper import RecordKeeper
from tacauchy_rig.config.model import RigConfig
from tacauchy_rig.run import JournalEvent
from tacauchy_rig.store.run_store import RunStore


def plan_session(store: RunStore) -> tuple[PlannedTrial, ...]:
    """Return what is left to do: trials without a passed attempt, numbered after earlier ones."""
    return tuple(
        PlannedTrial(
            spec=planned.spec,
            next_attempt=store.next_attempt(planned.spec.index),
            done=store.accepted(planned.spec.index) is not None,
        )
        for planned in fresh_plan(store.config)
    )


def run_session(
    store: RunStore,
    config: RigConfig,
    *,
    on_event: Callable[[JournalEvent], None],
    abort: Abort,
) -> SessionResult:
    """Run every trial without a passed attempt, with a process each for control, camera, record.

    Args:
        store: The run's folder; new, or one to resume.
        config: Its configuration, with the addresses of emulated devices filled in.
        on_event: Told of every journal event, and of ``progress`` five times a second, in this
            thread.
        abort: Asked at every turn of the control loop; see ``protocols.guard.abort_watch``.

    Raises:
        RecordError: Another program works on the run.
        DeviceError: Devices did not connect; all of them are named.
    """
    with (
        store.lock(),
        Supervisor(store, config, plan_session(store), on_event=on_event, abort=abort) as parent,
    ):
        return parent.run()


def run_session_in_process(
    store: RunStore,
    *,
    arm: Arm,
    force_sensor: ForceTorqueSensor,
    camera: Camera,
    clock: Clock,
    on_event: Callable[[JournalEvent], None],
    abort: Abort,
) -> ProgrammeResult:
    """Run with connected devices in this process; for mocks.

    Raises:
        RecordError: Another program works on the run.
    """
    with store.lock():
        keeper = RecordKeeper(store)
        sink = DirectSink(keeper)
        rig = Rig(
            arm=arm, force_sensor=force_sensor, camera=DirectCamera(camera, keeper), clock=clock
        )
        cycle = Cycle(rig, store.config, sink=sink, abort=abort)
        journal = Journal(sink, clock, listener=on_event)
        try:
            return run_programme(cycle, journal, plan_session(store))
        finally:
            keeper.close()
