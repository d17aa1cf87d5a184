"""A scene stated on the command line: the options that ``press`` and ``plan`` share."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, replace
from functools import wraps
from typing import Annotated, Any, Concatenate, ParamSpec, get_origin, get_type_hints

import typer

from sim.effects.estimates import expected_force
from sim.error.tolerance import keeping
from sim.scene.material import LawName, Layer, Material, interface_shares
from sim.scene.pad import Pad
from sim.scene.scene import Drive, Motion, Output, Preset, Scene, Target
from sim.scene.tetwild_options import TetWildOptions
from sim.sensor.sensor import Sensor, load_sensor
from tacauchy_rig.cli.scene_terms import (
    parse_contact,
    parse_indenter,
    parse_law,
    parse_layer,
    parse_pad,
    parse_pair,
    parse_switch,
    parse_tetwild_options,
)
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.loop.settings import parse_tolerance
from tacauchy_rig.quantities import Dimension, parse_quantity

_Own = ParamSpec("_Own")

OutputOption = Annotated[
    list[Output] | None, typer.Option("--output", help="What else is asked for; may be repeated.")
]
DeviceOption = Annotated[
    str, typer.Option("--device", help="Where the kernels run: cpu or cuda:0.")
]


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneTerms:
    """A scene as texts of the command line; ``states_a_scene`` gives a command these options.

    ``outputs`` are no option of every command.
    """

    indenter: Annotated[
        str,
        typer.Option(
            "--indenter", help="cylinder:diameter=5mm[,fillet=], sphere:diameter=, plane, mesh:FILE"
        ),
    ]
    sensor: Annotated[str | None, typer.Option("--sensor", help="Sensor by name or TOML file.")] = (
        None
    )
    pad: Annotated[
        str | None,
        typer.Option("--pad", help="box:LxWxHmm, disc:radius=,height= or mesh:FILE,unit=mm"),
    ] = None
    depth: Annotated[str | None, typer.Option("--depth", help="Travel, such as 0.5mm.")] = None
    force: Annotated[str | None, typer.Option("--force", help="Target, such as 4.7332N.")] = None
    at: Annotated[
        str | None,
        typer.Option("--at", help="Where the tip comes down on the pad, such as 1,0.5mm."),
    ] = None
    shift: Annotated[
        str | None,
        typer.Option("--shift", help="Motion once pressed in, along x, or as 0.3,0.1mm."),
    ] = None
    twist: Annotated[
        str | None, typer.Option("--twist", help="Turn about z once pressed in, such as 5deg.")
    ] = None
    tilt: Annotated[
        str | None, typer.Option("--tilt", help="Of the indenter about x and y, such as 2,0deg.")
    ] = None
    young: Annotated[str | None, typer.Option("--young", help="Such as 0.3MPa.")] = None
    poisson: Annotated[float | None, typer.Option("--poisson", help="Such as 0.48.")] = None
    layers: Annotated[
        list[str] | None,
        typer.Option(
            "--layer",
            help="share=0.925,young=0.1MPa,poisson=0.48; once a layer, from the base upwards.",
        ),
    ] = None
    law: Annotated[
        str, typer.Option("--law", parser=parse_law, metavar=f"<{'|'.join(LawName)}>")
    ] = LawName.STABLE_NEO_HOOKEAN
    contact: Annotated[
        str, typer.Option("--contact", help="frictionless, bonded or friction:MU.")
    ] = "frictionless"
    duration: Annotated[
        str | None, typer.Option("--duration", help="Time that the press takes; 1 s if not given.")
    ] = None
    preset: Annotated[
        Preset | None, typer.Option("--preset", help="balanced, unless --tolerance chooses one.")
    ] = None
    mesh: Annotated[
        str | None,
        typer.Option(
            "--mesh",
            metavar="l_r=,epsilon_r=,stop_energy=,dihedral_min=",
            help="Settings of fTetWild, for scenes that it meshes; "
            "those left out are the preset's.",
        ),
    ] = None
    tolerance: Annotated[
        str | None,
        typer.Option(
            "--tolerance",
            metavar="0.02N|1%",
            help="Take the cheapest preset that keeps F_z within it; with --preset, "
            "leave out effects within it.",
        ),
    ] = None
    effects: Annotated[
        list[str] | None,
        typer.Option("--effect", metavar="NAME=on|off", help="Overrule the plan; may be repeated."),
    ] = None
    drive: Annotated[Drive, typer.Option("--drive", help="How a force is reached.")] = Drive.LOAD
    outputs: tuple[Output, ...] = ()


def states_a_scene(command: Callable[Concatenate[SceneTerms, _Own], None]) -> Callable[..., None]:
    """Give a command the options of a scene; what they say is its first argument.

    Typer reads a command's options from its signature, which is put together here.
    """
    shared = _scene_parameters()
    _, *own = inspect.signature(command, eval_str=True).parameters.values()

    @wraps(command)
    def with_scene(*args: _Own.args, **options: _Own.kwargs) -> None:
        terms: dict[str, Any] = {each.name: options.pop(each.name) for each in shared}
        command(SceneTerms(**terms), *args, **options)

    signature = inspect.Signature([*shared, *own], return_annotation=None)
    with_scene.__signature__ = signature  # type: ignore[attr-defined]
    return with_scene


def _scene_parameters() -> list[inspect.Parameter]:
    """Return the fields of ``SceneTerms`` that are options."""
    hints = get_type_hints(SceneTerms, include_extras=True)
    return [
        inspect.Parameter(
            each.name,
            inspect.Parameter.POSITIONAL_OR_KEYWORD,
            default=inspect.Parameter.empty if each.default is MISSING else each.default,
            annotation=hints[each.name],
        )
        for each in fields(SceneTerms)
        if get_origin(hints[each.name]) is Annotated
    ]


def scene_of(terms: SceneTerms) -> Scene:
    """Read a scene.

    Raises:
        ConfigError: A text is not understood, the scene is not complete, or no preset keeps the
            tolerance.
    """
    if (terms.sensor is None) == (terms.pad is None):
        raise ConfigError("a press needs either --sensor or --pad", remedy="give exactly one")
    known = None if terms.sensor is None else load_sensor(terms.sensor)
    layers = _layers(known, terms)
    contact, friction = parse_contact(terms.contact)
    duration = _quantity(terms.duration, Dimension.TIME, "--duration")
    pad = known.pad if known is not None else parse_pad(terms.pad or "")
    scene = Scene(
        pad=pad,
        material=layers[-1].material,
        layers=layers if interface_shares(layers) else (),
        indenter=parse_indenter(terms.indenter),
        target=_target(terms, pad),
        centre_m=parse_pair(terms.at, Dimension.LENGTH, "--at"),
        contact=contact,
        friction=friction,
        motion=Motion(
            shift_m=parse_pair(terms.shift, Dimension.LENGTH, "--shift"),
            twist_rad=_quantity(terms.twist, Dimension.ANGLE, "--twist") or 0.0,
            tilt_rad=parse_pair(terms.tilt, Dimension.ANGLE, "--tilt"),
        ),
        duration_s=1.0 if duration is None else duration,
        outputs=frozenset(terms.outputs),
        effects=tuple(parse_switch(text) for text in terms.effects or ()),
        drive=terms.drive,
        preset=terms.preset or Preset.BALANCED,
        tetwild=_tetwild_options(known, terms),
        sensor=terms.sensor or "",
    )
    if terms.tolerance is None:
        return scene
    tolerance = parse_tolerance(terms.tolerance, field="--tolerance")
    if terms.preset is None:
        return keeping(scene, tolerance)
    return replace(scene, tolerance=tolerance.of(expected_force(scene)))


def _target(terms: SceneTerms, pad: Pad) -> Target:
    """Read depth or force; neither may be negative, and no press goes through the gel."""
    depth = _quantity(terms.depth, Dimension.LENGTH, "--depth")
    force = _quantity(terms.force, Dimension.FORCE, "--force")
    for option, text, value, positive in (
        ("--depth", terms.depth, depth, "0.5mm"),
        ("--force", terms.force, force, "1N"),
    ):
        if value is not None and value < 0.0:
            raise ConfigError(
                f"{option} {text} is negative",
                remedy=f"pressing counts as positive: give for example {option} {positive}",
            )
    if depth is not None and depth >= pad.height_m:
        raise ConfigError(
            f"--depth of {depth * 1e3:g} mm goes through a gel that is {pad.height_m * 1e3:g} mm "
            "thick",
            remedy="give less than the thickness",
        )
    return Target(depth_m=depth, force_n=force)


def _tetwild_options(sensor: Sensor | None, terms: SceneTerms) -> TetWildOptions:
    """Return the sensor's settings of fTetWild unless others are given."""
    if terms.mesh is not None:
        return parse_tetwild_options(terms.mesh)
    return TetWildOptions() if sensor is None else sensor.tetwild


def _layers(sensor: Sensor | None, terms: SceneTerms) -> tuple[Layer, ...]:
    """Return the gel's layers, one for a gel of one material."""
    one_material = terms.young is not None or terms.poisson is not None
    known = () if sensor is None else sensor.layers
    if one_material and (terms.layers or known):
        raise ConfigError(
            "--young and --poisson do not say which layer they are for",
            remedy="give every layer with --layer share=,young=,poisson=, from the base upwards",
        )
    if terms.layers:
        return tuple(parse_layer(text, law=terms.law) for text in terms.layers)
    if known:
        return tuple(replace(k, material=replace(k.material, law=terms.law)) for k in known)
    whole = None if sensor is None else sensor.material
    return (Layer(share=1.0, material=_material(whole, terms)),)


def _material(known: Material | None, terms: SceneTerms) -> Material:
    young = _quantity(terms.young, Dimension.PRESSURE, "--young")
    if known is not None:
        return replace(
            known,
            young_pa=known.young_pa if young is None else young,
            poisson=known.poisson if terms.poisson is None else terms.poisson,
            law=terms.law,
        )
    if young is None or terms.poisson is None:
        raise ConfigError(
            "--pad has no material of its own",
            remedy="give --young and --poisson too, or --layer for every layer",
        )
    return Material(young_pa=young, poisson=terms.poisson, law=terms.law)


def _quantity(text: str | None, dimension: Dimension, field: str) -> float | None:
    return None if text is None else parse_quantity(text, dimension=dimension, field=field)
