"""The expected force against depth of a run's presses, simulated with the stated gel.

It is made before a session with preset fast and kept in the run's folder. The control loop compares
the force sensor with it.
"""

import logging
import math

import numpy as np

from sim.effects.effect_choice import plan_effects
from sim.effects.press_outputs import outputs_of
from sim.effects.press_with_effects import path_for
from sim.error_estimate import estimated
from sim.replay import replay_scene
from sim.scene.indenter import Cylinder
from sim.scene.scene import Preset
from tacauchy_rig.app.replay.simulator_inputs import indenter_of, sensor_of
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.config.stated_uncertainty import DEPTH_ERROR_M, LAG_S, MOUNTING_TILT_RAD
from tacauchy_rig.core.errors import ConfigError, ConvergenceError
from tacauchy_rig.core.run import ExpectedPress
from tacauchy_rig.core.store.run_store import RunStore

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
