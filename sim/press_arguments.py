"""A scene from the words of ``tacauchy-rig press``."""

import shlex
from dataclasses import replace
from typing import Any

from sim.cheapest_setting import keeping_corrected
from sim.effects.depth_and_inertia_scales import expected_force
from sim.scene import scene_parsing as parsing
from sim.scene.material import Layer, Material, interface_shares
from sim.scene.pad import Pad
from sim.scene.scene import (
    Drive,
    Motion,
    Output,
    Preset,
    Scene,
    SceneTerms,
    Target,
    TetWildOptions,
    parse_tetwild_options,
)
from sim.sensor.sensor import Sensor, load_sensor
from sim.tolerance import Tolerance, parse_tolerance
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import Dimension, parse_quantity
from tacauchy_rig.core.registry import Kind, unknown

# Options that are no text, and those that may stand several times.
_READERS = {"poisson": float, "preset": Preset, "drive": Drive, "output": Output}
_REPEATED = {"layer", "effect", "output"}


def scene_from(words: str) -> Scene:
    """Return the scene that ``tacauchy-rig press`` simulates with these options.

    For example ``--sensor digit --indenter sphere:diameter=5mm --depth 0.5mm``.

    Raises:
        ConfigError: An option or a value is not understood, or the scene is not complete.
    """
    given: dict[str, Any] = {}
    try:
        parts = shlex.split(words)
        if len(parts) % 2:
            raise ValueError(f"{parts[-1]} has no value")
        for option, value in zip(parts[::2], parts[1::2], strict=True):
            name = option.removeprefix("--")
            read = _READERS.get(name, str)(value)
            given[name] = [*given.get(name, ()), read] if name in _REPEATED else read
        terms = SceneTerms(**given)
    except (TypeError, ValueError) as error:
        raise ConfigError(
            f"{words}: {str(error).removeprefix('SceneTerms.__init__() ')}",
            remedy="write options as `tacauchy-rig press --help` lists them",
        ) from error
    return scene_of(terms)


def scene_of(terms: SceneTerms) -> Scene:
    """Read a scene.

    Raises:
        ConfigError: A text is not understood, the scene is not complete, or no preset keeps the
            tolerance.
    """
    if (terms.sensor is None) == (terms.pad is None):
        raise ConfigError("a press needs either --sensor or --pad", remedy="give exactly one")
    if problem := unknown(Kind.LAW, terms.law):
        raise ConfigError(f"--law: {problem}", remedy="give one of them, or install its package")
    known = None if terms.sensor is None else load_sensor(terms.sensor)
    layers = _layers(known, terms)
    contact, friction = parsing.parse_contact(terms.contact)
    duration = _quantity(terms.duration, Dimension.TIME, "--duration")
    pad = known.pad if known is not None else parsing.parse_pad(terms.pad or "")
    tetwild = known.tetwild if known is not None else TetWildOptions()
    tolerance, others = tolerances_of(terms.tolerance)
    scene = Scene(
        pad=pad,
        material=layers[-1].material,
        layers=layers if interface_shares(layers) else (),
        indenter=parsing.parse_indenter(terms.indenter),
        target=_target(terms, pad),
        centre_m=parsing.parse_pair(terms.at, Dimension.LENGTH, "--at"),
        contact=contact,
        friction=friction,
        motion=Motion(
            shift_m=parsing.parse_pair(terms.shift, Dimension.LENGTH, "--shift"),
            twist_rad=_quantity(terms.twist, Dimension.ANGLE, "--twist") or 0.0,
            tilt_rad=parsing.parse_pair(terms.tilt, Dimension.ANGLE, "--tilt"),
        ),
        duration_s=1.0 if duration is None else duration,
        outputs=frozenset(terms.output),
        effects=tuple(parsing.parse_switch(text) for text in terms.effect or ()),
        drive=terms.drive,
        preset=terms.preset or Preset.BALANCED,
        tetwild=tetwild if terms.mesh is None else parse_tetwild_options(terms.mesh),
        output_tolerances=others,
        sensor=terms.sensor or "",
    )
    if tolerance is None:
        return scene
    if terms.preset is None:
        return keeping_corrected(scene, tolerance)
    return replace(scene, tolerance=tolerance.of(expected_force(scene)))


def tolerances_of(text: str | None) -> tuple[Tolerance | None, tuple[tuple[Output, float], ...]]:
    """Read F_z's tolerance and those of other outputs, such as ``1%,shear=5%``."""
    force, others = None, []
    for part in [] if text is None else text.split(","):
        name, is_named, value = part.rpartition("=")
        if not is_named:
            force = parse_tolerance(value, field="--tolerance")
        elif name not in set(Output):
            raise ConfigError(
                f'--tolerance: "{name}" is no output', remedy=f"choose from {', '.join(Output)}"
            )
        else:
            share = parse_quantity(value, dimension=Dimension.RATIO, field=f"--tolerance {name}")
            others.append((Output(name), share))
    return force, tuple(others)


def _target(terms: SceneTerms, pad: Pad) -> Target:
    """Read depth or force; neither may be negative, and no press goes through the gel."""
    depth = _quantity(terms.depth, Dimension.LENGTH, "--depth")
    force = _quantity(terms.force, Dimension.FORCE, "--force")
    for option, text, value in (("--depth", terms.depth, depth), ("--force", terms.force, force)):
        if value is not None and value < 0.0:
            raise ConfigError(
                f"{option} {text} is negative",
                remedy=f"pressing counts as positive: give {option} {str(text).lstrip('- ')}",
            )
    if depth is not None and depth >= pad.height_m:
        raise ConfigError(
            f"--depth of {depth * 1e3:g} mm goes through a gel that is {pad.height_m * 1e3:g} mm "
            "thick",
            remedy="give less than the thickness",
        )
    return Target(depth_m=depth, force_n=force)


def _layers(sensor: Sensor | None, terms: SceneTerms) -> tuple[Layer, ...]:
    """Return the gel's layers, one for a gel of one material."""
    young = _quantity(terms.young, Dimension.PRESSURE, "--young")
    given = {"young_pa": young, "poisson": terms.poisson}
    stated: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    known = () if sensor is None else sensor.layers
    if stated and (terms.layer or known):
        raise ConfigError(
            "--young and --poisson do not say which layer they are for",
            remedy="give every layer with --layer share=,young=,poisson=, from the base upwards",
        )
    if terms.layer:
        return tuple(parsing.parse_layer(text, law=terms.law) for text in terms.layer)
    if known:
        return tuple(replace(k, material=replace(k.material, law=terms.law)) for k in known)
    if sensor is None and len(stated) < len(given):
        raise ConfigError(
            "--pad has no material of its own",
            remedy="give --young and --poisson too, or --layer for every layer",
        )
    stated["law"] = terms.law
    material = Material(**stated) if sensor is None else replace(sensor.material, **stated)
    return (Layer(share=1.0, material=material),)


def _quantity(text: str | None, dimension: Dimension, field: str) -> float | None:
    return None if text is None else parse_quantity(text, dimension=dimension, field=field)
