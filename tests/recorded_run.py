"""A whole run of the mock rig in simulated time, on disk as the processes of a session leave it."""

import shutil
import tempfile
from collections.abc import Callable, Set
from functools import cache
from pathlib import Path

from drivers.camera.frame_checks import TouchWatch
from drivers.emulators.faults import parse_fault
from drivers.interfaces import FrameMark, Rig, StreamHealth, TouchMode
from protocols.control.cycle import Cycle, Entry, Journal, Sink
from protocols.guard.abort import Abort
from protocols.processes.camera_process import mark_of
from protocols.processes.recorder_process import RecordKeeper, encoded
from protocols.trials.trial_sequence import ProgrammeResult, plan_session, run_programme
from tacauchy_rig.core.config.load import LoadedConfig, default_text, load_config
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.registry import Kind, load
from tacauchy_rig.core.run import JournalEvent
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.run_store import RunStore
from tests.mock.bench import MockBench, SimulatedClock
from tests.mock.streams import MockCamera
from tests.mock.world import MockWorld

SHORT = (
    'protocol.air_press_height="2 mm"',
    'protocol.approach_height="0.5 mm"',
    'sensor.surface_uncertainty="0.2 mm"',
    'robot.home=["0 mm", "-400 mm", "203 mm"]',
    'robot.search_speed="1 mm/s"',
    'robot.press_speed="0.5 mm/s"',
)
"""Short ways and quick speeds: half the time of a trial."""
TWO_PRESSES = (
    'robot.model="cb3"',
    'protocol.force_targets=["1.2 N", "2 N"]',
    *SHORT,
    'protocol.tare_duration="0.3 s"',
    'protocol.reference_duration="0.3 s"',
    'protocol.dwell_duration="1 s"',
)
"""On an arm that reports its state a quarter as often as an e-Series."""


class KeptOnDisk:
    """A sink that keeps at once what it is given."""

    def __init__(self, store: RunStore) -> None:
        self.keeper = RecordKeeper(store)

    def put(self, entry: Entry) -> None:
        """Keep an entry."""
        self.keeper.keep(encoded(entry))

    def problem(self) -> str:
        """Return that there is none."""
        return ""

    def lag_s(self) -> float:
        """Return zero."""
        return 0.0


class RecordedCamera:
    """A mock camera whose frames are kept as they come."""

    def __init__(self, camera: MockCamera, sink: Sink) -> None:
        self._camera = camera
        self._sink = sink
        self._touch = TouchWatch()

    def ask(self, mode: TouchMode) -> None:
        """Look for something else."""
        self._touch.ask(mode)

    def poll(self) -> list[FrameMark]:
        """Keep new frames and return their marks."""
        frames = self._camera.drain()
        if frames:
            self._sink.put(tuple(frames))
        return [mark_of(frame, self._touch) for frame in frames]

    def health(self) -> StreamHealth:
        """Return the camera's health."""
        return self._camera.health()


def coarse_sensor(folder: Path, times: int) -> Path:
    """Write the file of a GelSight Mini whose images have so many times larger pixels."""
    text: str = load(Kind.SENSOR, "gelsight-mini").read_text("utf-8")
    changes = {"= 320": f"= {320 // times}", "= 240": f"= {240 // times}"}
    for fine, coarse in {**changes, "0.0634 mm": f"{0.0634 * times:.4f} mm"}.items():
        assert fine in text
        text = text.replace(fine, coarse)
    path = folder / "coarse.toml"
    path.write_text(text, encoding="utf-8")
    return path


def empty_run(parent: Path, loaded: LoadedConfig | None = None) -> RunStore:
    """Return an empty run folder of emulated devices, by default with the default configuration."""
    versions = {"tacauchy-rig": "0"}
    return RunStore.create(
        parent,
        loaded or load_config(),
        config_text=default_text(),
        simulated=True,
        versions=versions,
    )


def new_run(parent: Path, *overrides: str) -> RunStore:
    """Return an empty run folder of the mock rig."""
    return empty_run(parent, load_config(overrides=[*TWO_PRESSES, *overrides]))


def pressed_run(parent: Path, *overrides: str) -> RunStore:
    """Return a copy of a run whose trials were pressed; each is recorded once in a process."""
    root = _recorded(overrides)
    return RunStore.open(shutil.copytree(root, parent / root.name))


@cache
def _recorded(overrides: tuple[str, ...]) -> Path:
    store = new_run(Path(tempfile.mkdtemp(dir=_folder().name)), *overrides)
    press_run(store)
    return store.paths.root


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="recorded-", ignore_cleanup_errors=True)


def press_run(
    store: RunStore,
    *,
    seed: int = 1,
    start_ns: int = 10**9,
    again: Set[int] = frozenset(),
    config: RigConfig | None = None,
    silent_fault: tuple[str, str] | None = None,
) -> ProgrammeResult:
    """Press every trial without a passed attempt, in simulated time.

    Args:
        store: The run.
        seed: Of the noise.
        start_ns: When it begins [ns].
        again: Trials to press once more though they passed.
        config: The run's own if None.
        silent_fault: A phase, and the fault that begins there and stays.
    """
    config = config or store.config
    world = MockWorld(SimulatedClock(start_ns=start_ns), config, seed=seed)
    bench = MockBench.on(world)
    sink = KeptOnDisk(store)
    rig = Rig(
        arm=bench.arm,
        force_sensor=bench.force_sensor,
        camera=RecordedCamera(bench.camera, sink),
        clock=world.clock,
    )
    store.set_devices({"robot": bench.arm.connect(), "camera": bench.camera.connect()})
    note(store, world, "run-start", pids={})
    cycle = Cycle(rig, config, sink=sink, abort=Abort(same_request_s=0.0))
    journal = Journal(sink, world.clock, listener=_observer(world, silent_fault))
    result = run_programme(cycle, journal, plan_session(store, again=again))
    sink.keeper.close()
    note(store, world, "run-end", outcome=result.outcome.value, reason=result.reason)
    return result


def _observer(
    world: MockWorld, silent_fault: tuple[str, str] | None
) -> Callable[[JournalEvent], None]:
    def heard(event: JournalEvent) -> None:
        if silent_fault is None or event.detail.get("phase") != silent_fault[0]:
            return
        if not world.faults:
            world.begin(parse_fault(silent_fault[1]))

    return heard


def note(store: RunStore, world: MockWorld, name: str, **detail: object) -> None:
    """Write what the supervisor of a session writes."""
    event = JournalEvent(stamp_ns=world.clock.now_ns(), name=name, detail=detail)
    append_event(store.paths.journal, event)
