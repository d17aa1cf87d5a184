"""A whole session: from a run folder and a configuration to six kept trials."""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import replace

from protocols.guard.abort import Abort
from protocols.processes.messages import PageWish, ViewerWish
from protocols.processes.supervisor import SessionResult, Supervisor
from protocols.trials.programme import fresh_plan
from protocols.trials.trial import PlannedTrial
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.expected_press import ExpectedPress
from tacauchy_rig.core.run import JournalEvent
from tacauchy_rig.core.store.run_store import RunStore


def plan_session(store: RunStore, *, again: Set[int] = frozenset()) -> tuple[PlannedTrial, ...]:
    """Return what is left to do: trials without a passed attempt, numbered after earlier ones.

    Args:
        store: The run's folder.
        again: Trials to press once more though they have a passed attempt.
    """
    plan = []
    for planned in fresh_plan(store.config):
        passed = store.accepted(planned.index)
        plan.append(
            replace(
                planned,
                next_attempt=store.next_attempt(planned.index),
                done=planned.index not in again and passed is not None,
                contact_z_m=None if passed is None else passed.contact_z_m,
            )
        )
    return tuple(plan)


def run_session(
    store: RunStore,
    config: RigConfig,
    *,
    on_event: Callable[[JournalEvent], None],
    abort: Abort,
    expected: ExpectedPress | None = None,
    again: Set[int] = frozenset(),
    page: PageWish | None = None,
    viewers: Sequence[ViewerWish] = (),
) -> SessionResult:
    """Run every trial without a passed attempt, with a process each for control, camera, record.

    Args:
        store: The run's folder; new, or one to resume.
        config: Its configuration, with the addresses of emulated devices filled in.
        on_event: Told of every journal event, and of ``progress`` five times a second, in this
            thread.
        abort: Asked at every turn of the control loop; see ``protocols.guard.abort``.
        expected: What a press should give; None where nobody knows.
        again: Trials to press once more though they have a passed attempt.
        page: The operator's page; None for none. Its address comes as the event ``page``.
        viewers: Further viewers.

    Raises:
        ConfigError: The page's port is taken.
        RecordError: Another program works on the run.
        DeviceError: Devices did not connect; all of them are named.
    """
    with (
        store.lock(),
        Supervisor(
            store,
            config,
            plan_session(store, again=again),
            on_event=on_event,
            abort=abort,
            expected=expected,
            page=page,
            viewers=viewers,
        ) as parent,
    ):
        return parent.run()
