"""Tilt and place of a run's indenter: found from moments and images, simulated if needed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from reports.evidence.frames_and_curves import AttemptReading
from reports.evidence.modulus_and_tilt_fit import TRIALS_MIN, TiltFit, fit_modulus, fit_tilt
from reports.scores.contact_scores import image_change, register_changes, touched
from sim.effects.effect_choice import output_tolerances, plan_effects
from sim.sensor.camera_geometry import CameraGeometry
from sim.tilt_sensitivity import can_tilt, press_tilted, restoring_moments, tilt_costs
from tacauchy_rig.app.replay.simulator_inputs import Part, ReplayInputs
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.config.settings import ModulusSource, PoseSource, RigConfig, RobotModel
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.simulated import ForceDepthCurve, FoundValue

TAKEN_FROM = 2.0
"""A value within this many of its standard uncertainties of zero is taken as zero."""
PLACE_ERROR_M = {RobotModel.E_SERIES: 30e-6, RobotModel.CB3: 100e-6}
"""Repeatability of a pose, from data sheets."""
_TRIED_RAD = math.radians(1.0)
"""The moment grows in proportion up to there: at a quarter of it K is the same to 2 %."""
_TILT, _OFFSET = "lean towards", "offset along"
"""Names of what is found, as replays keep them; x or y follows."""


Dwell = tuple[TrialRecord, tuple[FloatArray, FloatArray] | None]
"""A held press, and mean and standard error of its wrench in the cell's frame [N, N m], shape [6]
each; None where it is unknown."""


def mounted(part: Part, attempts: Sequence[AttemptReading]) -> Part:
    """Return a part with the measured duration and, if asked for, the tilt that moments show."""
    inputs, config = part.inputs, part.config
    known = [each.press_duration_s for each in attempts if each.press_duration_s is not None]
    if known:
        inputs = replace(inputs, duration_s=median(known))
    if config.replay.pose is not PoseSource.FOUND:
        return replace(part, inputs=inputs)
    dwells = [(each.record, each.dwell_wrench) for each in attempts]
    fit, why = tilt_of(dwells, inputs, config)
    if fit is None:
        row = _row(any(inputs.tilt_rad), f"as stated: {why}")
        return replace(part, inputs=inputs, found=_values(_TILT, "rad", why), effects=(row,))
    size = float(np.linalg.norm(fit.tilt_rad))
    doubt = float(np.linalg.norm(fit.tilt_rad * fit.uncertainty_rad)) / max(size, 1e-30)
    taken = size > TAKEN_FROM * doubt
    values = _values(_TILT, "rad", why, fit.tilt_rad, fit.uncertainty_rad, taken=taken)
    found = f"found {_degrees(size)} +- {_degrees(doubt)} by {why}"
    row = _row(False, f"{found}; within {TAKEN_FROM:g} times its uncertainty of none")
    if taken:
        row = _planned(inputs, [r.force_measured_n or 0.0 for r, _ in dwells], size, found)
    tilt = (float(fit.tilt_rad[0]), float(fit.tilt_rad[1])) if row["on"] else (0.0, 0.0)
    inputs = replace(inputs, tilt_rad=tilt)
    return replace(part, inputs=inputs, found=values, effects=(row,))


def tilt_of(
    dwells: Sequence[Dwell], inputs: ReplayInputs, config: RigConfig
) -> tuple[TiltFit | None, str]:
    """Fit the tilt to the moments; return it and its basis, or None and the reason."""
    known = sorted(
        ((r, wrench) for r, wrench in dwells if wrench and (r.force_measured_n or 0.0) > 0.0),
        key=lambda pair: pair[0].force_measured_n or 0.0,
    )
    forces_n = np.array([record.force_measured_n for record, _ in known])
    if not can_tilt(inputs.indenter):
        return None, "a tilt does not change a ball"
    if len(known) < TRIALS_MIN:
        return None, f"{len(known)} presses carry moments; at least {TRIALS_MIN} are needed"
    if not config.force_sensor.is_emulated and config.force_sensor.to_tip is None:
        return None, "force_sensor.to_tip is not stated: moments refer to an unknown point"
    # The forces of the coarse tilted presses enclose what may be measured.
    targets_n, allowed_n = config.protocol.force_targets, config.protocol.force_tolerance
    ends_n = {min(targets_n) - allowed_n, max(targets_n) + allowed_n}
    tried_n = sorted(force_n for force_n in {*targets_n, *ends_n} if force_n > 0.0)
    if config.is_imported or forces_n[0] < tried_n[0] or tried_n[-1] < forces_n[-1]:
        tried_n = forces_n.tolist()
    try:
        resisting_nm, pressed = restoring_moments(inputs.scene(tried_n), tried_n, _TRIED_RAD)
    except RigError as error:
        return None, f"a coarse press with a tilt failed: {error.message}"
    factor = 1.0
    if fits_modulus(config):
        curve = ForceDepthCurve.merged([pressed.history])
        contact_n = config.protocol.contact_force
        fitted = fit_modulus([([r for r, _ in known], curve)], contact_force_n=contact_n)
        factor = 1.0 if fitted is None else fitted.factor
    moments, errors = _about_tip(np.array([w for _, w in known]), config)
    against = np.interp(forces_n / factor, tried_n, resisting_nm)
    fit = fit_tilt(forces_n, moments, errors, factor * against)
    size, most = float(np.linalg.norm(fit.tilt_rad)), config.workspace.max_tilt
    if size > most:
        return None, (
            f"moments give a tilt of {_degrees(size)}, more than workspace.max_tilt, "
            f"{_degrees(most)}: check force_sensor.to_tip and how the cell is turned"
        )
    return fit, f"the moments of {len(known)} trials"


def fits_modulus(config: RigConfig) -> bool:
    """Return whether the gel's modulus is fitted to the run's depths."""
    return config.replay.modulus is ModulusSource.DEPTHS and config.replay.young is None


def tilted_curve(curve: ForceDepthCurve | None, inputs: ReplayInputs) -> ForceDepthCurve | None:
    """Return the curve of an upright press, its depths shifted as the tilt shifts them.

    The shift is taken from coarse presses: a tilted face first touches off its middle.
    """
    if curve is None:
        return None
    forces_n = np.unique(curve.force_n[curve.force_n > 0.0]).tolist()
    scene, tilt_rad = inputs.scene(forces_n), math.hypot(*inputs.tilt_rad)
    even, tilted = (np.array(press_tilted(scene, forces_n, by).history) for by in (0.0, tilt_rad))
    extra_m = np.concatenate([[0.0], tilted[:, 0] - even[:, 0]])
    shift_m = np.interp(curve.force_n, [0.0, *forces_n], extra_m)
    return replace(curve, depth_m=curve.depth_m + shift_m)


def _about_tip(wrenches: FloatArray, config: RigConfig) -> tuple[FloatArray, FloatArray]:
    """Return moments about x and y of the base frame at the tip, and their errors [N m].

    The cell's axes are the tool's, turned by half a turn about x where its Fz is positive while
    something presses.

    Args:
        wrenches: Mean and standard error in the cell's frame, shape [trial_count, 2, 6].
    """
    sign, to_tip_m = config.force_sensor.compression_sign, config.force_sensor.to_tip or 0.0
    tool = Rotation.from_rotvec(config.robot.tool_rotation).as_matrix()
    turn = tool @ np.diag([1.0, -sign, -sign])
    x, y, z = to_tip_m * tool[:, 2]
    # Of a force at the tip, the moment about the cell's point.
    lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    maps = np.concatenate([-lever @ turn, turn], axis=1)[:2]
    mean, error = wrenches[:, 0], wrenches[:, 1]
    return mean @ maps.T, np.sqrt(np.square(error) @ np.square(maps).T)


def _planned(
    inputs: ReplayInputs, forces_n: Sequence[float], tilt_rad: float, found: str
) -> dict[str, Any]:
    """Return whether a tilt is simulated: as for effects, the error of leaving it out is tried."""
    scene = inputs.scene(forces_n)
    try:
        costs = tilt_costs(scene, max(forces_n), tilt_rad)
    except RigError as error:
        return _row(True, f"{found}; simulated because a coarse press failed: {error.message}")
    plan, allowed = plan_effects(inputs.upright.scene(forces_n)), output_tolerances(scene)
    sums = {output: cost + plan.left_out(output) for output, cost in costs.items()}
    worst = max(sums, key=lambda output: sums[output] / allowed[output])
    on = sums[worst] > allowed[worst]
    verb = "would be" if on else "is"
    reason = (
        f"{found}; tried coarsely: with all that is left out {worst.value} {verb} "
        f"{sums[worst]:.2%} off, {allowed[worst]:.2%} allowed"
    )
    return _row(on, reason, {output.value: cost for output, cost in costs.items()})


def _row(on: bool, reason: str, costs: dict[str, float] | None = None) -> dict[str, Any]:
    known = {} if costs is None and not on else costs
    error = None if known is None else max(known.get(name, 0.0) for name in ("force", "depth"))
    return {
        "name": "tilt",
        "on": on,
        "reason": reason,
        "estimated_error": error,
        "costs": known,
        "asked": False,
    }


def find_offset(
    attempts: Sequence[AttemptReading],
    images: Mapping[int, ImageArray],
    geometry: CameraGeometry,
    config: RigConfig,
) -> tuple[FoundValue, ...]:
    """Return how far images show the contact from its simulated place, along x and y."""
    scale_m = np.array([geometry.scale_x_m, geometry.scale_y_m])
    shifts = []
    for attempt in attempts:
        seen, simulated = attempt.images, images.get(attempt.record.index)
        if seen is None or simulated is None:
            continue
        real, made = (image_change(each, seen.reference) for each in (seen.real, simulated))
        contact = touched(seen)
        shift = None if contact is None else register_changes(real, made, contact.region)
        if shift is not None:
            shifts.append(np.array(shift) * scale_m)
    if len(shifts) < 2:
        why = f"{len(shifts)} images show the contact; at least two are needed"
        return _values(_OFFSET, "m", why)
    mean = np.mean(shifts, axis=0)
    scatter = np.std(shifts, axis=0, ddof=1) / math.sqrt(len(shifts))
    arm_m = 0.0 if config.is_imported else PLACE_ERROR_M[config.robot.model]
    doubt = np.hypot(scatter, arm_m)
    taken = bool(np.any(np.abs(mean) > TAKEN_FROM * doubt))
    arm = "; the arm is not known" if config.is_imported else " and the arm's repeatability"
    basis = f"the images of {len(shifts)} trials{arm}"
    return _values(_OFFSET, "m", basis, mean, doubt, taken=taken)


def offset_of(values: Sequence[FoundValue]) -> tuple[float, float] | None:
    """Return the offset that is to be simulated [m]; None where none is."""
    along = [value for value in values if value.name.startswith(_OFFSET)]
    if not along or not all(value.taken for value in along):
        return None
    x, y = (value.value or 0.0 for value in along)
    return x, y


def _values(
    name: str,
    unit: str,
    basis: str,
    found: FloatArray | None = None,
    doubt: FloatArray | None = None,
    *,
    taken: bool = False,
) -> tuple[FoundValue, ...]:
    """Return what was found along x and along y with its standard uncertainty; None is unknown."""
    return tuple(
        FoundValue(
            name=f"{name} {axis}",
            value=None if found is None else float(found[k]),
            uncertainty=None if doubt is None else float(doubt[k]),
            unit=unit,
            taken=taken,
            basis=basis,
        )
        for k, axis in enumerate("xy")
    )


def _degrees(angle_rad: float) -> str:
    return f"{math.degrees(angle_rad):.2f} deg"
