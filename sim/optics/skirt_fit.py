"""The skirt's decay length from the presses themselves, where no simulated profile is at hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from sim.optics.ball_press import BallPress
from sim.optics.calibrate import calibrate_optics
from sim.optics.gel_profile import ExponentialSkirt
from sim.optics.press_scene import PressScene

_SHORTEST, _LONGEST = 0.2, 1.5
_GRID = 7


def fit_skirt(
    presses: Sequence[BallPress], scene: PressScene, *, ball_radius_m: float
) -> ExponentialSkirt:
    """Choose the decay length with which the model explains contact and skirt best.

    Lengths between 0.2 and 1.5 of the median contact radius are searched, first on a grid, because
    long skirts are told apart badly; each is judged by the mean absolute residual after one round
    of calibration.

    Args:
        presses: Images with labelled circles.
        scene: Camera and no-contact frame; its profile is not used.
        ball_radius_m: Radius of the ball [m].

    Raises:
        ConfigError: There is no press, or one has another size than the no-contact frame.
    """
    contact = scene.geometry.mean_scale_m * float(
        np.median([press.circle.radius_px for press in presses] or [1.0])
    )

    def residual(decay_m: float) -> float:
        skirt = ExponentialSkirt(ball_radius_m=ball_radius_m, decay_m=decay_m)
        trial = replace(scene, profile=skirt, stride=2 * scene.stride)
        found = calibrate_optics(presses, trial, rounds=1)
        model, errors = found.model, []
        for press, circle, light in zip(presses, found.circles, found.lights, strict=True):
            seen = found.scene.samples(press, circle, light, found.model)
            features = seen.features(model.exponents, model.terms)
            coefficients = np.concatenate([model.coefficients, model.term_coefficients])
            left = seen.change - features.T @ coefficients
            errors.append(np.abs(left))
        return float(np.concatenate(errors).mean())

    tried = contact * np.geomspace(_SHORTEST, _LONGEST, _GRID)
    lowest = int(np.argmin([residual(decay) for decay in tried]))
    best = minimize_scalar(
        residual,
        bounds=(tried[max(lowest - 1, 0)], tried[min(lowest + 1, _GRID - 1)]),
        method="bounded",
        options={"xatol": 0.03 * contact, "maxiter": 6},
    )
    return ExponentialSkirt(ball_radius_m=ball_radius_m, decay_m=float(best.x))
