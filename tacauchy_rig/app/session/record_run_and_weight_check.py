"""Make a run, and what it asks of cell and gel before it presses.

The expected force against depth of its presses, simulated with the stated gel, is made before a
session with preset fast and kept in the run's folder. The control loop compares the force sensor
with it.
"""

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from drivers.force_sensor.weighing import Load, weigh
from protocols.guard.force_witness_and_band import TOLERANCE, WORST_N, WORST_SHARE
from sim.effects.effect_choice import plan_effects
from sim.effects.press_outputs import outputs_of
from sim.effects.press_with_effects import path_for
from sim.error_estimate import estimated
from sim.replay import replay_scene
from sim.scene.indenter import Cylinder
from sim.scene.scene import Preset
from tacauchy_rig.app.replay.simulator_inputs import indenter_of, sensor_of
from tacauchy_rig.core.config.load import Change, LoadedConfig
from tacauchy_rig.core.config.settings import DEPTH_ERROR_M, LAG_S, MOUNTING_TILT_RAD, RigConfig
from tacauchy_rig.core.errors import ConfigError, ConvergenceError, RigError
from tacauchy_rig.core.known_weight import EXPIRY_H, ForceCheck, Weight, judge_weight
from tacauchy_rig.core.run import ExpectedPress, JournalEvent, Outcome, TrialRecord
from tacauchy_rig.core.store.free_space import check_free_space
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.json_codec import to_json
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.versions import versions

logger = logging.getLogger(__name__)

UNCERTAINTIES = 2.0
"""Standard uncertainties of the stiffness that the band allows either way: 95 % of gels."""
STIFFNESS_OF_HEIGHT = 1.0
STIFFNESS_OF_POISSON = 3.0
"""How a punch's stiffness follows the gel's height (power of it) and Poisson's ratio (relative
change over the change of nu): 5 mm punch, 4 mm gel, 2 N, preset fast at 3.6 mm and at nu 0.47
(0.93 and 2.8)."""
UNKNOWN_ERROR = 0.1
"""Relative error of the simulated force where nothing is known of it; preset fast, largest of the
presses in docs/results/accuracy.md at nu 0.48 or below, doubled."""
BEYOND = 1.6
"""The curve goes to this many times the largest target, so that it includes the softest gel."""
_POINTS = 12
_FIRST_SHARES = (0.01, 0.03)
"""Of the largest force: the first points of the curve, where a gel is softest."""


def expected_press(config: RigConfig) -> ExpectedPress:
    """Press the stated gel in simulation, a little beyond the largest target.

    Raises:
        ConvergenceError: The simulator does not get there.
        ConfigError: There is no such sensor.
    """
    sensor, indenter = sensor_of(config), indenter_of(config)
    most_n = BEYOND * max(config.protocol.force_targets)
    friction = config.replay.friction
    scene = replay_scene(sensor, indenter, [most_n], preset=Preset.FAST, friction=friction)
    plan = plan_effects(scene)
    path = path_for(scene, plan)
    shares = [*_FIRST_SHARES, *np.linspace(0.0, 1.0, _POINTS)[1:].tolist()]
    points = [path.push(share * most_n) for share in shares]
    found = estimated(scene, plan, outputs_of(path, points[-1])).force
    error = UNKNOWN_ERROR if found is None else found
    # How stiff the gel is under an indenter, by its standard uncertainties.
    parts = [sensor.young_uncertainty()[0]]
    if height := sensor.numbers.get("pad.height"):
        parts.append(STIFFNESS_OF_HEIGHT * height.uncertainty / height.value)
    parts.append(STIFFNESS_OF_POISSON * sensor.least_certain_poisson.uncertainty)
    spread = 1.0 + UNCERTAINTIES * math.hypot(*parts)
    overrun_m, lean_m = config.robot.press_speed * LAG_S, 0.0
    if isinstance(indenter, Cylinder):  # how far the edge of a tilted face is below its middle
        lean_m = (indenter.radius_m - indenter.fillet_m) * math.sin(MOUNTING_TILT_RAD)
    return ExpectedPress(
        sensor=sensor.name,
        made=f"{sensor.title}, preset {scene.preset.value}, {error:.0%} too stiff at most, "
        f"{UNCERTAINTIES:g} x {(spread - 1.0) / UNCERTAINTIES:.0%} of uncertainty",
        depth_m=(0.0, *(point.depth_m for point in points)),
        force_n=(0.0, *(float(point.force_n[2]) for point in points)),
        # A conforming mesh is too stiff, never too soft.
        low=1.0 / (spread * (1.0 + error)),
        high=spread,
        lean_m=lean_m,
        depth_error_m=DEPTH_ERROR_M[config.robot.model] + overrun_m,
        gel_height_m=sensor.pad.height_m,
    )


def kept_expectation(store: RunStore) -> ExpectedPress | None:
    """Return what a run's presses should give: read from its folder, or made and kept there.

    Returns:
        None where there is no such sensor or the simulator does not get there; the run goes on
        with the other checks of the force, and its journal records that.

    Raises:
        RecordError: Another program works on the run, the disk is full or gone, or the file is
            damaged.
    """
    known = store.expected.load()
    if known is not None:
        return known
    try:
        made = expected_press(store.config)
    except (ConfigError, ConvergenceError) as error:
        logger.warning("no expected press: %s", error)
        return None
    with store.lock():
        store.expected.save(made)
    return made


class ForceCheckError(RigError):
    """The cell does not say what hangs on it, so nothing may be pressed by its word."""


def check_cell(
    store: RunStore, config: RigConfig, weight: Weight, *, ask: Callable[[Load], None]
) -> ForceCheck:
    """Weigh a known weight with the run's cell, and keep what was found, right or wrong.

    Args:
        config: Its configuration with the addresses that hold now.
        ask: Returns once the cell carries what is asked for.

    Raises:
        ForceCheckError: Size, sign or axis is wrong; the likely cause stands in the remedy.
        DeviceError: The cell does not answer.
    """
    with store.lock():
        before, loaded, after = weigh(config, ask=ask)
        check = judge_weight(
            weight,
            before=before,
            loaded=loaded,
            after=after,
            compression_sign=config.force_sensor.compression_sign,
            checked=datetime.now(UTC).isoformat(timespec="seconds"),
        )
        store.force_check.save(check)
        append_event(store.paths.journal, JournalEvent.now("force-check", **to_json(check)))
    if not check.passed:
        raise ForceCheckError(f"the force sensor is wrong: {check.finding}", remedy=check.remedy)
    return check


def needs_weight(config: RigConfig) -> bool:
    """Return whether the arm feels too little to bound what a wrong cell may do to the gel.

    ``limits.allow_unchecked_force`` admits that.
    """
    arm, target_n = TOLERANCE[config.robot.model], min(config.protocol.force_targets)
    return not (config.limits.allow_unchecked_force or arm.bounds(target_n))


def require_bounded_force(store: RunStore, config: RigConfig) -> None:
    """Refuse to press by a cell that nothing has checked and no arm would contradict.

    Raises:
        ForceCheckError: It is so, or the cell was found wrong when it was checked last; the likely
            cause and how to check it again stand in the remedy.
    """
    check = store.force_check.load()
    if check is not None and not check.passed:
        raise ForceCheckError(
            f"the force sensor was wrong at its last check, on {check.checked}: {check.finding}",
            remedy=f"{check.remedy}; then repeat it: --check-weight "
            f"{check.weight.mass_kg * 1e3:g}g",
        )
    if needs_weight(config) and (note := standing_check(store)):
        arm, target_n = TOLERANCE[config.robot.model], min(config.protocol.force_targets)
        raise ForceCheckError(
            f"{note}; robot.model {config.robot.model.value} feels force to {arm.force_n:g} N and "
            f"{arm.share:.0%} only, so at protocol.force_targets {target_n:g} N a wrong force "
            f"sensor could cause more than {WORST_SHARE * target_n + WORST_N:.2f} N; nothing moved",
            remedy="add --check-weight 200g with a weight at hand; or "
            "limits.allow_unchecked_force = true, which the report will say",
        )


def standing_check(store: RunStore, *, now: datetime | None = None) -> str:
    """Return why the force of what is pressed now is not checked; empty where it is."""
    check = store.force_check.load()
    if check is None:
        return "force not checked: --check-weight 200g checks the force sensor with a known weight"
    if _is_current(check, now or datetime.now(UTC)):
        return ""
    return (
        f"force not checked: the check of {check.checked} has expired after {EXPIRY_H:g} h; "
        f"--check-weight {check.weight.mass_kg * 1e3:g}g repeats it"
    )


def mark_expired(store: RunStore, *, now: datetime | None = None) -> None:
    """Note in a check that has expired that trials are added to it, for the report to say so."""
    check, now = store.force_check.load(), now or datetime.now(UTC)
    if check is not None and not _is_current(check, now):
        store.force_check.save(replace(check, expired=now.isoformat(timespec="seconds")))


def _is_current(check: ForceCheck, now: datetime) -> bool:
    return now - datetime.fromisoformat(check.checked) <= timedelta(hours=EXPIRY_H)


def create_run(loaded: LoadedConfig, config_text: str) -> RunStore:
    """Make a run's folder in the configured output directory.

    Args:
        config_text: Its file as it was written, kept in the folder.

    Raises:
        RecordError: The folder cannot be made, or has no room for the recordings.
    """
    config = loaded.config
    parent = Path(config.run.output_directory)
    check_free_space(parent, config)
    return RunStore.create(
        parent,
        loaded,
        config_text=config_text,
        simulated=config.has_emulated_devices,
        versions=versions(),
    )


def note_changes(store: RunStore, changes: Sequence[Change]) -> None:
    """Write into the journal what a run goes on with that it did not begin with.

    Raises:
        RecordError: Another program works on the run, or the journal cannot be written.
    """
    if not changes:
        return
    event = JournalEvent.now("resume-set", changes=[asdict(change) for change in changes])
    with store.lock():
        append_event(store.paths.journal, event)


def missed_lines(records: Sequence[TrialRecord]) -> Iterator[str]:
    """Yield a line for each criterion that the last attempt at a trial missed.

    It names the trial, the criterion, what was measured, what was asked, and what to do.
    """
    for record in records:
        if record.outcome is not Outcome.FAILED:
            continue
        tries = f", attempt {record.attempt}" if record.attempt > 1 else ""
        for each in record.criteria:
            if not each.passed:
                measured = f"{each.measured:.4g} {each.unit}".rstrip()
                told = f"{each.name} is {measured}, required: {each.limit}"
                remedy = f" -> {each.remedy}" if each.remedy else ""
                yield f"missed: trial {record.index}{tries}: {told}{remedy}"
