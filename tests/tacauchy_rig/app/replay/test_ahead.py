"""Going ahead: the same replay, whoever took the walk."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from reports.evidence.attempt import RunReading
from sim.sensor.sensor import Sensor
from tacauchy_rig.app.replay import ahead
from tacauchy_rig.app.replay.inputs import ReplayInputs
from tacauchy_rig.app.replay.mounting import restoring_of, tried_forces
from tacauchy_rig.app.replay.opening import open_run
from tacauchy_rig.app.replay.optics import OpticalCalibration, Say, nominal_optics
from tacauchy_rig.app.replay.parts import Part, parts_of
from tacauchy_rig.app.replay.pressing import Pressed, press_parts, walk_ahead
from tacauchy_rig.core.config.load import LoadedConfig, default_text, load_config
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import Outcome, TrialRecord
from tacauchy_rig.core.store.run_store import RunStore

FAST = ("replay.preset=fast", 'protocol.force_targets=["1 N", "1.5 N"]')
PRESSED = ((0.99, 0.170e-3), (1.52, 0.245e-3))
"""What was measured: force [N] and depth [m]."""


def _config(*more: str) -> LoadedConfig:
    return load_config(None, overrides=[*FAST, *more])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunReading:
    """Two presses with forces and depths."""
    store = RunStore.create(
        tmp_path_factory.mktemp("ahead"),
        _config(),
        config_text=default_text(),
        simulated=True,
        versions={"x": "1"},
    )
    for index, (force_n, depth_m) in enumerate(PRESSED, start=1):
        store.paths.attempt(index, 1).mkdir(parents=True)
        record = TrialRecord(
            index=index,
            attempt=1,
            outcome=Outcome.PASSED,
            force_target_n=force_n,
            force_measured_n=force_n,
            depth_measured_m=depth_m,
        )
        store.save_result(record)
    return open_run(store.paths.root)


@pytest.fixture(scope="module")
def parts(run: RunReading) -> list[Part]:
    """The same as one part."""
    return parts_of(run)


@pytest.fixture(scope="module")
def alone(parts: list[Part]) -> Pressed:
    """What is pressed when it is asked for."""
    (pressed,) = press_parts(parts)
    return pressed


def _alike(first: Pressed, second: Pressed) -> None:
    for one, other in zip(first[0].trials, second[0].trials, strict=True):
        assert one.force_simulated_n == other.force_simulated_n
        assert one.depth_simulated_m == other.depth_simulated_m
    for index, fields in first[1].items():
        np.testing.assert_array_equal(
            fields.passed[-1].pressure_pa, second[1][index].passed[-1].pressure_pa
        )


def test_a_walk_taken_before_is_the_one_that_would_be_taken(
    parts: list[Part], alone: Pressed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last bit, and it is not taken again."""
    walk = walk_ahead(_config().config)
    assert walk is not None
    monkeypatch.setattr(
        "tacauchy_rig.app.replay.pressing.walked", lambda *_, **__: pytest.fail("twice")
    )
    (pressed,) = press_parts(parts, walks=[walk])
    _alike(pressed, alone)


def test_a_walk_of_another_scene_serves_nobody(parts: list[Part]) -> None:
    """It leads somewhere else; in a gel that remembers nothing, its time says nothing."""
    walk = walk_ahead(_config().config)
    assert walk is not None
    asked = walk.scene
    assert walk.leads(replace(asked, duration_s=2.0 * asked.duration_s))
    assert not walk.leads(replace(asked, friction=0.2))
    assert not walk.leads(parts[0].inputs.scene([PRESSED[-1][0]]))


def test_the_process_beside_presses_the_same(parts: list[Part], alone: Pressed) -> None:
    """What it has to tell is told."""
    said: list[str] = []
    with ahead.going_ahead(parts[0].config, None) as company:
        assert company is not None
        (pressed,) = company.pressing(parts, said.append)()
        optics, told = company.seen()
    _alike(pressed, alone)
    assert any("times the stated modulus" in line for line in said)
    assert optics.model.provenance
    assert "nominal optics" in told[0]


def test_optics_that_could_not_be_told_ahead_are_told_when_asked(
    parts: list[Part], tmp_path: Path
) -> None:
    """The emulated world, or a file, came later."""
    there = tmp_path / "there"
    with ahead.going_ahead(parts[0].config, partial(_if_there, there)) as company:
        assert company is not None
        company.other.submit(len, ()).result()
        there.touch()
        _, told = company.seen()
    assert told == ["it is there"]


def _if_there(path: Path, sensor: Sensor, say: Say) -> OpticalCalibration:
    if not path.exists():
        raise RecordError(f"{path} is not there")
    say("it is there")
    return nominal_optics(sensor)


def test_what_the_configuration_tells_is_told_before(
    run: RunReading, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The inputs and the answer to a lean that would be found, and none is found twice."""
    (part,) = parts_of(run)
    with ahead.going_ahead(part.config, None) as company:
        assert company is not None
        foreseen = company.foreseen()
    assert foreseen is not None
    restoring = foreseen.restoring
    assert restoring is not None
    found = restoring_of(part.inputs, tried_forces(part.config))
    np.testing.assert_array_equal(restoring.moments_nm, found.moments_nm)
    assert restoring.forces_n[0] < PRESSED[0][0] < PRESSED[-1][0] < restoring.forces_n[-1]
    monkeypatch.setattr(ReplayInputs, "settled", lambda *_: pytest.fail("twice"))
    (early,) = parts_of(run, foreseen=foreseen)
    assert early.inputs.scene([1.5]).refinement == part.inputs.scene([1.5]).refinement
    other = _config("sensor.name=digit").config
    assert not foreseen.settles(other)


def test_nobody_goes_ahead_on_one_processor(
    parts: list[Part], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The devices need it."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    with ahead.going_ahead(parts[0].config, None) as company:
        assert company is None


def test_what_nobody_can_know_before_is_not_pressed_before() -> None:
    """A stated modulus is not told, and a lean leads elsewhere."""
    assert walk_ahead(_config("replay.young=0.3 MPa").config) is None
    assert walk_ahead(_config('replay.tilt=["1 deg", "0 deg"]').config) is None
