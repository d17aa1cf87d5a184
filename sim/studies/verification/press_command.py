"""A scene as the ``tacauchy-rig press`` command that states it."""

from __future__ import annotations

from sim.scene.indenter import describe
from sim.scene.material import LawName
from sim.scene.pad import DiscPad
from sim.scene.scene import ContactMode, Drive, Scene
from tacauchy_rig.errors import ConfigError


def press_command(scene: Scene) -> str:
    """Return the command of a straight press in the middle of a sensor or of a disc.

    Raises:
        ConfigError: The scene asks for what this cannot write.
    """
    parts = ["tacauchy-rig press", *_pad(scene), "--indenter", describe(scene.indenter)]
    target = scene.target
    if target.depth_m is not None:
        parts += ["--depth", f"{target.depth_m * 1e3:.10g}mm"]
    else:
        parts += ["--force", f"{target.force_n:.10g}N"]
    material = scene.material
    parts += [
        "--young",
        f"{material.young_pa * 1e-6:.10g}MPa",
        "--poisson",
        f"{material.poisson:g}",
    ]
    if material.law != LawName.STABLE_NEO_HOOKEAN:
        parts += ["--law", material.law]
    if scene.contact is not ContactMode.FRICTIONLESS:
        parts += ["--contact", scene.contact.value]
    if scene.drive is not Drive.LOAD:
        parts += ["--drive", scene.drive.value]
    return " ".join([*parts, "--preset", scene.preset.value])


def _pad(scene: Scene) -> list[str]:
    if scene.sensor:
        return ["--sensor", scene.sensor]
    if isinstance(scene.pad, DiscPad):
        pad = scene.pad
        return ["--pad", f"disc:radius={pad.radius_m * 1e3:g}mm,height={pad.height_m * 1e3:g}mm"]
    raise ConfigError(
        "a verification scene has neither a sensor nor a disc", remedy="name its sensor"
    )
