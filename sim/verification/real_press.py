"""Young's modulus from one press of a real GelSight Mini gel."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any

from sim.indenter import Sphere
from sim.press import press
from sim.scene import ContactMode, Material, Preset, Scene, Target
from sim.sensor import load_sensor
from sim.verification.command import press_command
from sim.verification.section import Section
from tacauchy_rig.quantities import Dimension, parse_quantity

_FILE = "real_press.toml"
_ALLOWED = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class RealPress:
    """A press that somebody measured."""

    source: str
    sensor: str
    ball_radius_m: float
    depth_m: float
    force_n: float


@dataclass(frozen=True, slots=True, kw_only=True)
class YoungFit:
    """A modulus at which a simulated press meets a measured one.

    Attributes:
        force_n: F_z with ``young_pa``, pressed anew [N].
    """

    poisson: float
    contact: ContactMode
    young_pa: float
    force_n: float


def measure(*, preset: Preset = Preset.ACCURATE) -> Section:
    """Fit E, and show what the fit hangs on."""
    real, sensor = real_press(), load_sensor(real_press().sensor)
    file_young, file_poisson = sensor.numbers["material.young"], sensor.numbers["material.poisson"]
    spread = file_poisson.uncertainty
    asked = (
        (file_poisson.value, ContactMode.FRICTIONLESS),
        (file_poisson.value, ContactMode.BONDED),
        (file_poisson.value - spread, ContactMode.FRICTIONLESS),
        (file_poisson.value + spread, ContactMode.FRICTIONLESS),
    )
    fits = [fit_young(real, poisson, contact, preset) for poisson, contact in asked]
    best = fits[0]
    off = (best.young_pa - file_young.value) / file_young.uncertainty
    return Section(
        title="One press of a real gel",
        columns=("nu", "contact", "fitted E [MPa]", "F_z with it [N]", "measured [N]"),
        rows=tuple(
            (f.poisson, f.contact.value, f.young_pa * 1e-6, f.force_n, real.force_n) for f in fits
        ),
        criterion="E is fitted to the one point and stated; pressed anew with it, F_z is the "
        f"measured one within 0.1 %; preset {preset.value}",
        passed=all(abs(f.force_n / real.force_n - 1.0) <= _ALLOWED for f in fits),
        note=f"{real.source}: radius {real.ball_radius_m * 1e3:g} mm, {real.force_n:g} N at "
        f"{real.depth_m * 1e3:g} mm, on the sensor's own domed pad. The fit is "
        f"E = {best.young_pa * 1e-6:.4f} MPa (first row), {off:+.1f} standard uncertainties from "
        f"the sensor file's {file_young.value * 1e-6:g} MPa, which was measured on another unit "
        "and stays. A fit to one point verifies nothing; the presses to other depths do.",
        command=press_command(real_scene(real, best.young_pa, best.poisson, best.contact, preset)),
    )


def real_press() -> RealPress:
    """Return the measured press."""
    text = resources.files("sim.verification.data").joinpath(_FILE).read_text("utf-8")
    data: dict[str, Any] = tomllib.loads(text)
    return RealPress(
        source=data["source"],
        sensor=data["sensor"],
        ball_radius_m=parse_quantity(data["ball_radius"], Dimension.LENGTH),
        depth_m=parse_quantity(data["depth"], Dimension.LENGTH),
        force_n=parse_quantity(data["force"], Dimension.FORCE),
    )


def fit_young(real: RealPress, poisson: float, contact: ContactMode, preset: Preset) -> YoungFit:
    """Scale E, to which a force at given depth is proportional, and press again."""
    scene = real_scene(real, load_sensor(real.sensor).material.young_pa, poisson, contact, preset)
    young = scene.material.young_pa * real.force_n / press(scene).force_n[2]
    again = replace(scene, material=Material(young_pa=young, poisson=poisson))
    return YoungFit(
        poisson=poisson, contact=contact, young_pa=young, force_n=press(again).force_n[2]
    )


def real_scene(
    real: RealPress, young_pa: float, poisson: float, contact: ContactMode, preset: Preset
) -> Scene:
    """Return the measured press as a scene."""
    sensor = load_sensor(real.sensor)
    return Scene(
        pad=sensor.pad,
        material=Material(young_pa=young_pa, poisson=poisson),
        indenter=Sphere(diameter_m=2.0 * real.ball_radius_m),
        target=Target(depth_m=real.depth_m),
        contact=contact,
        preset=preset,
        sensor=sensor.name,
    )
