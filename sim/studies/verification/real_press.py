"""Young's modulus from one press of a real GelSight Mini gel."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib import resources

from sim.press import press
from sim.press_command import scene_from
from sim.scene.scene import ContactMode, Preset
from sim.sensor.sensor import load_sensor
from sim.studies.verification.prose import stated
from tacauchy_rig.core.tables import Table

_FILE = "real_press.toml"
_ALLOWED = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class RealPress:
    """A press that somebody measured, as the command line takes it."""

    source: str
    press: str
    force_n: float


def measure(*, preset: Preset = Preset.ACCURATE) -> Table:
    """Fit E, press anew with it, and show what the fit hangs on."""
    real = real_press()
    numbers = load_sensor(scene_from(real.press).sensor).numbers
    young, poisson = numbers["material.young"], numbers["material.poisson"]
    asked = (
        (poisson.value, ContactMode.FRICTIONLESS),
        (poisson.value, ContactMode.BONDED),
        (poisson.value - poisson.uncertainty, ContactMode.FRICTIONLESS),
        (poisson.value + poisson.uncertainty, ContactMode.FRICTIONLESS),
    )
    fits = [fitted_young(real, nu, contact, preset) for nu, contact in asked]
    words = real_words(real, fits[0], *asked[0], preset)
    force = press(scene_from(words)).force_n[2]
    forces = (force, None, None, None)
    return Table(
        **stated(
            "real",
            preset=preset,
            real=real,
            scene=scene_from(real.press),
            fit=fits[0],
            young=young,
        ),
        columns=("nu", "contact", "fitted E [MPa]", "F_z pressed anew [N]", "measured [N]"),
        rows=tuple(
            (nu, contact.value, fit * 1e-6, again, real.force_n)
            for (nu, contact), fit, again in zip(asked, fits, forces, strict=True)
        ),
        passed=abs(force / real.force_n - 1.0) <= _ALLOWED,
        command=f"tacauchy-rig press {words}",
    )


def real_press() -> RealPress:
    """Return the measured press."""
    text = resources.files("sim.studies.verification.data").joinpath(_FILE).read_text("utf-8")
    data = tomllib.loads(text)
    return RealPress(source=data["source"], press=data["press"], force_n=data["force_n"])


def fitted_young(real: RealPress, poisson: float, contact: ContactMode, preset: Preset) -> float:
    """Return the E [Pa] at which a press gives the measured force, to which it is proportional."""
    young = scene_from(real.press).material.young_pa
    scene = scene_from(real_words(real, young, poisson, contact, preset))
    return young * real.force_n / press(scene).force_n[2]


def real_words(
    real: RealPress, young_pa: float, poisson: float, contact: ContactMode, preset: Preset
) -> str:
    """Return the measured press with another gel, contact and preset."""
    gel = f"--young {young_pa * 1e-6:.10g}MPa --poisson {poisson:g}"
    return f"{real.press} {gel} --contact {contact.value} --preset {preset.value}"
