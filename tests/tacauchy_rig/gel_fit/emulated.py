"""Presses of emulated gels: the simulator's, with everything drawn that a fit calls uncertain."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from reports.evidence.loading import stated_of_run
from sim.scene.scene import Preset
from sim.sensitivity import forces_at
from tacauchy_rig.config.load import load_config
from tacauchy_rig.gel_fit.presses import IndenterPresses
from tacauchy_rig.gel_fit.response import gel_of
from tacauchy_rig.loop.inputs import inputs_of
from tacauchy_rig.loop.uncertainty import variations

BALL, PUNCH, WIDE = (
    "sphere:diameter=6mm",
    "cylinder:diameter=4mm,fillet=0.5mm",
    "cylinder:diameter=8mm,fillet=0.5mm",
)
DEPTHS_M = np.array([0.2e-3, 0.35e-3, 0.5e-3, 0.65e-3, 0.8e-3])
NOISE_N = 0.008
# As a rig that is set up for it: tool and gel lined up, a good cell.
MEASURED = (
    'uncertainty.tilt="0 deg"',
    'uncertainty.offset="0 mm"',
    'uncertainty.diameter="10 um"',
    'uncertainty.fillet="10 um"',
    'uncertainty.depth="3 um"',
    'uncertainty.force_scale="0.5 %"',
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Gel:
    """A drawn gel."""

    young_pa: float
    poisson: float
    friction: float


def drawn_gel(seed: int) -> Gel:
    """Draw a gel as far off the file as gels may be."""
    random = np.random.default_rng([seed, 1])
    return Gel(
        young_pa=435e3 * float(random.uniform(0.6, 1.6)),
        poisson=float(random.uniform(0.45, 0.485)),
        friction=float(random.uniform(0.1, 0.8)),
    )


def presses_of(
    seed: int, indenter: str, *, preset: Preset = Preset.FAST, press_count: int | None = None
) -> IndenterPresses:
    """Press a drawn gel: the height of the gel is the same under all of a seed's indenters.

    Args:
        preset: Of the true presses.
        press_count: All points are of so many presses; None gives each its own.
    """
    config = load_config(overrides=(*MEASURED, f'replay.indenter="{indenter}"')).config
    stated, gel = inputs_of(config), drawn_gel(seed)
    shared, own = np.random.default_rng([seed, 2]), np.random.default_rng([seed, len(indenter), 3])
    sensor = stated.sensor.stiffer(gel.young_pa / stated.sensor.material.young_pa)
    inputs = gel_of(replace(stated, sensor=sensor, preset=preset), gel.poisson, gel.friction)
    for name in [each.name for each in variations(inputs, config)]:
        (each,) = (found for found in variations(inputs, config) if found.name == name)
        if name in ("Poisson's ratio", "friction"):
            continue
        random = shared if name.startswith(("gel", "dome")) else own
        inputs = each.changed(each.stated.value * random.standard_normal())
    doubts = stated_of_run(config, None)
    gain = 1.0 + doubts["force_scale"].value * shared.standard_normal()
    count = press_count or len(DEPTHS_M)
    press = np.arange(len(DEPTHS_M)) % count
    low_m = doubts["depth"].value * own.standard_normal(count)[press]
    scene = replace(inputs.scene([1.0]), outputs=frozenset())
    true_n = gain * forces_at(scene, DEPTHS_M + low_m)
    return IndenterPresses(
        config=config,
        inputs=stated,
        contact_force_n=0.0,
        press=press,
        depth_m=DEPTHS_M,
        force_n=true_n + NOISE_N * own.standard_normal(len(DEPTHS_M)),
        noise_n=np.full(len(DEPTHS_M), NOISE_N),
    )
