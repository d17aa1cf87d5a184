"""Study "power-cuts": what a power cut can leave of a run, state by state."""

import logging
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from protocols.trials.trial_sequence import plan_session
from tacauchy_rig.app.cli.output import Found, Jobs, complain, say
from tacauchy_rig.core.errors import RecordError, RigError
from tacauchy_rig.core.store.recovery import recover_run
from tacauchy_rig.core.store.run_store import RunStore
from tests.recorded_run import new_run, press_run
from tests.studies.power_cuts.states import History, draw_state, finished_recordings

RESUMED_EVERY = 50  # states that are pressed to their end; the others are planned only
AGAIN_EVERY = 10  # states that are recovered a second time
SECOND_SESSION_NS = 200 * 10**9
THIRD_SESSION_NS = 400 * 10**9
SHORT = ('robot.model="cb3"',)


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """What became of a state."""

    number: int
    cut_s: float
    said: tuple[str, ...]  # what was unlike the moment of the cut
    # What was wrong afterwards, in words; empty where there was a way forward.
    failures: tuple[str, ...]


def recorded_history(parent: Path) -> History:
    """Press a run of two trials in simulated time, and one of them again in a second session."""
    store = new_run(parent, *SHORT)
    press_run(store)
    press_run(store, start_ns=SECOND_SESSION_NS, again={2})
    return History.of(store.paths.root)


def observe(number: int, *, history: History, seed: int) -> Observation:
    """Make a state, recover it, and go on with it."""
    state = draw_state(history, number, seed=seed)
    with tempfile.TemporaryDirectory(dir=history.root.parent) as folder:
        root = state.write(history, Path(folder))
        try:
            failures = tuple(_failures(root, history, number))
        except (RigError, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            failures = (f"{type(error).__name__}: {error}",)
    return Observation(number=number, cut_s=state.cut_s, said=state.said, failures=failures)


def _failures(root: Path, history: History, number: int) -> Iterator[str]:
    logging.getLogger("tacauchy_rig").setLevel(logging.ERROR)
    if not (root / "trials").exists():
        yield from _refusal(root)
        return
    finished = dict(finished_recordings(root, history))
    changed = partial(_changed, root, finished)
    recovery = recover_run(RunStore.open(root))
    yield from changed()
    yield from (f"the run: {c.name}: {c.limit}" for c in recovery.check.run if not c.passed)
    broken = {
        key for key, each in recovery.check.attempts.items() if not all(c.passed for c in each)
    }
    if recovery.was_cut_off:
        yield from (f"after recover: {line}" for line in recovery.check.missed())
    again = {trial for trial, _ in broken}  # as the remedies say: `resume RUN --again TRIAL`
    if number % AGAIN_EVERY == 0 and not broken:
        second = recover_run(RunStore.open(root))
        if not second.is_whole or any(report.changed for report in second.recordings):
            yield "a second recover is not content"
    store = RunStore.open(root)
    for planned in plan_session(store, again=again):
        if store.paths.attempt(planned.index, planned.next_attempt).exists():
            yield f"trial {planned.index}: attempt {planned.next_attempt} is there already"
        if planned.done and (planned.index, planned.next_attempt - 1) in broken:
            yield f"trial {planned.index} counts, and its attempt is broken"
    if number % RESUMED_EVERY == 0:
        ended = press_run(store, start_ns=THIRD_SESSION_NS, again=again)
        if ended.reason or any(store.accepted(each) is None for each in store.trial_indices()):
            yield f"resumed: {ended.outcome} {ended.reason}"
        whole = recover_run(RunStore.open(root)).check
        missed = {key for key, each in whole.attempts.items() if not all(c.passed for c in each)}
        yield from (f"after resume: attempt {key}" for key in sorted(missed - broken))
        yield from (f"after resume: {c.name}" for c in whole.run if not c.passed)
        yield from changed()


def _refusal(root: Path) -> Iterator[str]:
    """Yield what is wrong with a run that nothing was recorded in: a new one is its way forward."""
    try:
        RunStore.open(root)
    except RecordError as error:
        if not any(word in str(error) for word in ("record a new run", "not a run folder")):
            yield str(error)


def _changed(root: Path, finished: dict[str, bytes]) -> Iterator[str]:
    for name, content in finished.items():
        if (root / name).read_bytes() != content:
            yield f"{name} was finished and has changed"


_TOLD_EVERY = 250


def power_cuts(
    states: Annotated[int, typer.Option("--states", min=1, help="How many are drawn.")] = 5000,
    seed: Annotated[int, typer.Option("--seed", help="Of the states.")] = 1,
    jobs: Jobs = 2,
) -> Found:
    """Draw states that a power cut can leave; recover each, and resume every fiftieth.

    Example: python -m tests.studies power-cuts --states 5000 --jobs 2
    """
    from tacauchy_rig.core.parallel import parallel_map

    shared = Path("/dev/shm")  # noqa: S108 - where it is there, nothing waits for a disk
    with tempfile.TemporaryDirectory(dir=shared if shared.is_dir() else None) as folder:
        history = recorded_history(Path(folder))
        look = partial(observe, history=history, seed=seed)
        seen = []
        for _, found in parallel_map(look, range(states), jobs=jobs):
            seen.append(found)
            for failure in found.failures:
                complain(f"state {found.number}, cut at {found.cut_s:.2f} s: {failure}")
                complain(f"  {'; '.join(found.said) or 'nothing is torn'}")
            if len(seen) % _TOLD_EVERY == 0:
                say(f"{len(seen)} of {states} states")
    failed = [each for each in seen if each.failures]
    torn = sum(bool(each.said) for each in seen)
    say(
        f"{states} states (seed {seed}), {torn} of them with torn files: {len(failed)} without a "
        "way forward or with a finished recording changed"
    )
    return Found({"states": states, "seed": seed, "failed": failed}, passed=not failed)
