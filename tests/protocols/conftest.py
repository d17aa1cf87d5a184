"""A laboratory in memory for protocol tests: mocks on a simulated clock."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from drivers.interfaces import Rig
from protocols.control.cycle import Begin, Cycle, End, Entry, Journal
from protocols.guard.abort import Abort
from protocols.guard.breach_reaction import BreachError, Reaction
from protocols.trials.trial_sequence import PlannedTrial, ProgrammeResult, run_programme
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.run import (
    ArmSample,
    ExpectedPress,
    ForceSample,
    JournalEvent,
    Pose,
    TrialRecord,
    Vector3,
)
from tacauchy_rig.core.store.run_store import RunStore
from tests.mock.bench import MockBench, SimulatedClock
from tests.mock.real_time import load_mocks, mocks_installed
from tests.mock.world import MockWorld
from tests.recorded_run import SHORT, RecordedCamera, empty_run

STRICT = ('limits.stale_force="50 ms"', 'limits.stale_image="200 ms"', 'robot.watchdog="10 Hz"')
"""As on a rig: a simulated clock is never late."""
NEAR = (
    'robot.home=["0 mm", "-400 mm", "203 mm"]',
    'protocol.approach_height="1.1 mm"',
    'protocol.air_press_height="1.5 mm"',
)
"""Short ways at the speeds that are shipped."""
BRISK = (
    *SHORT,
    'robot.watchdog="2 Hz"',  # real time on a shared computer
    'protocol.tare_duration="0.2 s"',
    'protocol.reference_duration="0.2 s"',
    'protocol.dwell_duration="1 s"',
)
"""For tests that run in real time."""


@dataclass
class KeptInMemory:
    """A sink that keeps what it is given."""

    samples: list[ForceSample] = field(default_factory=list)
    states: list[ArmSample] = field(default_factory=list)
    events: list[JournalEvent] = field(default_factory=list)
    records: list[TrialRecord] = field(default_factory=list)
    begun: list[tuple[int, int]] = field(default_factory=list)
    trouble: str = ""

    def put(self, entry: Entry) -> None:
        """Remember an entry."""
        match entry:
            case Begin(trial=trial, attempt=attempt):
                self.begun.append((trial, attempt))
            case (ForceSample(), *_):
                self.samples += [each for each in entry if isinstance(each, ForceSample)]
            case (ArmSample(), *_):
                self.states += [each for each in entry if isinstance(each, ArmSample)]
            case JournalEvent():
                self.events.append(entry)
            case End(record=record):
                self.records.append(record)

    def problem(self) -> str:
        """Return the trouble that a test has made."""
        return self.trouble

    def lag_s(self) -> float:
        """Return zero."""
        return 0.0


@contextmanager
def breach(
    limit: str, reaction: Reaction | None = None, *, match: str | None = None
) -> Iterator[None]:
    """Expect a breach of a limit, with its reaction and a part of its message where given."""
    with pytest.raises(BreachError, match=match) as caught:
        yield
    assert caught.value.limit == limit
    assert reaction in (None, caught.value.reaction)
    assert caught.value.remedy


def arm_state(
    position: Vector3 = (0.0, 0.0, 0.0),
    *,
    rotation: Vector3 = (0.0, 0.0, 0.0),
    speed: float = 0.0,
    stamp_s: float = 0.0,
    force_n: float | None = None,
) -> ArmSample:
    """Return a state of an arm that moves along z, with its own estimate of F_z or none."""
    return ArmSample(
        stamp_ns=round(stamp_s * 1e9),
        controller_time_s=stamp_s,
        pose=Pose(position=position, rotation_vector=rotation),
        velocity=(0.0, 0.0, speed, 0.0, 0.0, 0.0),
        runtime_state=2,
        safety_bits=1,
        robot_mode=7,
        tcp_force=None if force_n is None else (0.0, 0.0, force_n, 0.0, 0.0, 0.0),
    )


def fresh_plan(config: RigConfig) -> tuple[PlannedTrial, ...]:
    """Return the plan of a run that has no attempts yet."""
    targets = enumerate(config.protocol.force_targets, start=1)
    return tuple(PlannedTrial(index=index, force_target_n=target) for index, target in targets)


@dataclass
class Laboratory:
    """Everything a protocol test touches."""

    config: RigConfig
    world: MockWorld
    bench: MockBench
    sink: KeptInMemory
    abort: Abort
    cycle: Cycle
    journal: Journal

    def run(self, plan: Sequence[PlannedTrial] | None = None) -> ProgrammeResult:
        """Press the trials of a plan, or all of the configuration."""
        return run_programme(self.cycle, self.journal, plan or fresh_plan(self.config))

    @property
    def phases(self) -> list[str]:
        """Phases that were entered, in order."""
        return [event.detail["phase"] for event in self.sink.events if event.name == "phase"]

    def assert_rests(self) -> None:
        """Wait a second; the arm must not move then."""
        self.world.clock.sleep(1.0)
        self.world.catch_up()
        assert self.world.velocity == (0.0,) * 6

    def when_phase(self, phase: str, action: Callable[[], None], *, delay_s: float = 0.0) -> None:
        """Do ``action`` at a delay after ``phase`` was entered first."""

        def due() -> bool:
            entered = [e for e in self.sink.events if e.detail.get("phase") == phase]
            return bool(entered) and (
                self.world.now_ns >= entered[0].stamp_ns + round(delay_s * 1e9)
            )

        self.world.when(due, action)


def laboratory_of(
    world: MockWorld,
    *,
    expected: ExpectedPress | None = None,
    listener: Callable[[JournalEvent], object] = lambda _: None,
) -> Laboratory:
    """Put the mocks into a world, and return them with what presses and records."""
    config, bench, sink = world.config, MockBench.on(world), KeptInMemory()
    abort = Abort(same_request_s=0.0)
    rig = Rig(
        arm=bench.arm,
        force_sensor=bench.force_sensor,
        camera=RecordedCamera(bench.camera, sink),
        clock=world.clock,
    )
    return Laboratory(
        config=config,
        world=world,
        bench=bench,
        sink=sink,
        abort=abort,
        cycle=Cycle(rig, config, sink=sink, abort=abort, expected=expected),
        journal=Journal(sink, world.clock, listener=listener),
    )


def _laboratory(
    *overrides: str,
    expected: ExpectedPress | None = None,
    ways: Sequence[str] = SHORT,
    **world_arguments: Any,
) -> Laboratory:
    config = load_config(overrides=[*STRICT, *ways, *overrides]).config
    return laboratory_of(MockWorld(SimulatedClock(), config, **world_arguments), expected=expected)


@pytest.fixture(scope="session")
def laboratory() -> Callable[..., Laboratory]:
    """Return a maker of laboratories: configuration overrides, then the world's arguments."""
    return _laboratory


@pytest.fixture(scope="session")
def config() -> RigConfig:
    """Return the default configuration with mocks."""
    return load_config(overrides=STRICT).config


@pytest.fixture
def make_store(tmp_path: Path) -> Iterator[Callable[..., RunStore]]:
    """Return a maker of run folders for mocks in real time: short ways, given overrides."""

    def make(*overrides: str) -> RunStore:
        return empty_run(tmp_path / "runs", load_mocks(*BRISK, *overrides))

    with mocks_installed():
        yield make
