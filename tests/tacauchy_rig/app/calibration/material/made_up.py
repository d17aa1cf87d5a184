"""Responses that were made up: what an indenter feels of nu and friction stands in a formula."""

from dataclasses import replace

import numpy as np

from tacauchy_rig.app.calibration.material.fit_and_next_presses import NODES, OF_OTHER_LAW, Response
from tacauchy_rig.app.calibration.material.measured_presses import IndenterPresses
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.load import load_config
from tests.studies.gel.command import NOISE_N, measured

DEPTHS_M = np.linspace(1e-4, 8e-4, 8)
SURE = ('uncertainty.depth="20 um"', 'uncertainty.force_scale="0.1 %"')


def area(
    depth_m: FloatArray, *, poisson: float, friction: float, power: float, confined: float
) -> FloatArray:
    """Return force over modulus [m^2]; ``confined`` is how much nu counts."""
    size = 5e-3 ** (2.0 - power)
    grip = 1.0 + 0.2 * friction * depth_m / 1e-3
    return np.asarray(size * depth_m**power * grip * np.exp(confined * (poisson - 0.45)))


def made_response(*, power: float, confined: float) -> Response:
    """Return the surrogate of the formula."""
    depth = np.linspace(1e-4, 1e-3, 7)
    kind = {"power": power, "confined": confined}
    areas = [area(depth, poisson=nu, friction=mu, **kind) for nu, mu in NODES]
    areas += [each * (1.0 + 20.0 * depth) for each in areas[:OF_OTHER_LAW]]
    return replace(Response.of(depth, areas), uncertain=(0.002, 0.001))


def made_presses(
    indenter: str, *, young_pa: float, seed: int = 1, **formula: float
) -> IndenterPresses:
    """Return presses of the formula, which is that of ``area``, with noise."""
    config = load_config(overrides=(*SURE, f'replay.indenter="{indenter}"')).config
    noise_n = NOISE_N * np.random.default_rng(seed).standard_normal(len(DEPTHS_M))
    force_n = young_pa * area(DEPTHS_M, **formula) + noise_n
    return replace(measured(indenter, DEPTHS_M, force_n), config=config)
