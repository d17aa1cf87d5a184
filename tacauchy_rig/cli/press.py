"""``tacauchy-rig press``: one simulated press, stated on the command line."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import typer

from sim.indenter import describe
from sim.interface import interface_traction
from sim.laws import paper_eq4
from sim.laws.catalogue import LawName
from sim.layers import interface_shares
from sim.press import PressResult
from sim.press import press as simulate_press
from sim.scene import Layer, Material, Preset, Scene, Target
from sim.sensor import Sensor, load_sensor
from tacauchy_rig.cli.options import JsonFile
from tacauchy_rig.cli.output import complain, say, write_json
from tacauchy_rig.cli.press_terms import parse_contact, parse_indenter, parse_layer, parse_pad
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.quantities import Dimension, parse_quantity


def press(
    indenter: Annotated[
        str, typer.Option("--indenter", help="cylinder:diameter=5mm[,fillet=], sphere:diameter=")
    ],
    sensor: Annotated[
        str | None, typer.Option("--sensor", help="Sensor by name or TOML file.")
    ] = None,
    pad: Annotated[
        str | None, typer.Option("--pad", help="box:LxWxHmm or disc:radius=,height=")
    ] = None,
    depth: Annotated[str | None, typer.Option("--depth", help="Travel, such as 0.5mm.")] = None,
    force: Annotated[str | None, typer.Option("--force", help="Target, such as 4.7332N.")] = None,
    young: Annotated[str | None, typer.Option("--young", help="Such as 0.3MPa.")] = None,
    poisson: Annotated[float | None, typer.Option("--poisson", help="Such as 0.48.")] = None,
    layer: Annotated[
        list[str] | None,
        typer.Option(
            "--layer",
            help="share=0.925,young=0.1MPa,poisson=0.48; once a layer, from the base upwards.",
        ),
    ] = None,
    law: Annotated[LawName, typer.Option("--law")] = LawName.STABLE_NEO_HOOKEAN,
    contact: Annotated[
        str, typer.Option("--contact", help="frictionless or bonded.")
    ] = "frictionless",
    preset: Annotated[Preset, typer.Option("--preset")] = Preset.BALANCED,
    json_file: JsonFile = None,
) -> None:
    """Press once in the simulator and say what it took."""
    if (sensor is None) == (pad is None):
        raise ConfigError("press needs either --sensor or --pad", remedy="give exactly one")
    known = None if sensor is None else load_sensor(sensor)
    layers = _layers(known, layer or [], young, poisson, law)
    scene = Scene(
        pad=known.pad if known is not None else parse_pad(pad or ""),
        material=layers[-1].material,
        layers=layers if interface_shares(layers) else (),
        indenter=parse_indenter(indenter),
        target=Target(
            depth_m=_length(depth, "--depth"),
            force_n=None
            if force is None
            else parse_quantity(force, dimension=Dimension.FORCE, field="--force").value,
        ),
        contact=parse_contact(contact),
        preset=preset,
        sensor=sensor or "",
    )
    if law is LawName.PAPER_EQ4:
        _warn_of_rest_stress(scene.material)
    result = simulate_press(scene)
    _show(scene, result)
    _show_interfaces(result)
    write_json(json_file, result.as_json())


def _layers(
    sensor: Sensor | None, texts: list[str], young: str | None, poisson: float | None, law: LawName
) -> tuple[Layer, ...]:
    """Return the gel's layers, one for a gel of one material."""
    one_material = young is not None or poisson is not None
    known = () if sensor is None else sensor.layers
    if one_material and (texts or known):
        raise ConfigError(
            "--young and --poisson do not say which layer they are for",
            remedy="give every layer with --layer share=,young=,poisson=, from the base upwards",
        )
    if texts:
        return tuple(parse_layer(text, law=law) for text in texts)
    if known:
        return tuple(replace(k, material=replace(k.material, law=law)) for k in known)
    whole = None if sensor is None else sensor.material
    return (Layer(share=1.0, material=_material(whole, young, poisson, law)),)


def _material(
    known: Material | None, young: str | None, poisson: float | None, law: LawName
) -> Material:
    modulus = None if known is None else known.young_pa
    if young is not None:
        modulus = parse_quantity(young, dimension=Dimension.PRESSURE, field="--young").value
    if poisson is None and known is not None:
        poisson = known.poisson
    if modulus is None or poisson is None:
        raise ConfigError(
            "--pad has no material of its own",
            remedy="give --young and --poisson too, or --layer for every layer",
        )
    return Material(young_pa=modulus, poisson=poisson, law=law)


def _length(text: str | None, field: str) -> float | None:
    if text is None:
        return None
    return parse_quantity(text, dimension=Dimension.LENGTH, field=field).value


def _warn_of_rest_stress(material: Material) -> None:
    stress = paper_eq4.LAW.rest_stress(material.young_pa, material.poisson)
    shrink = 1.0 - paper_eq4.free_stretch(material.poisson)
    complain(
        f"warning: law {LawName.PAPER_EQ4} is the paper's Eq. 4 as printed. It has a tension of "
        f"{stress * 1e-3:.1f} kPa at rest; a free gel would shrink by {shrink:.1%} per axis. The "
        "pad is first solved without the indenter, and depth counts from touching that shape."
    )


def _show(scene: Scene, result: PressResult) -> None:
    error = result.estimated_force_error_relative
    believed = "not known" if error is None else f"{error:.1%}"
    say(f"{describe(scene.indenter)}, {scene.contact.value}, preset {scene.preset.value}")
    say(f"force      {result.force_n[2]:.4f} N at {result.depth_m * 1e3:.4f} mm")
    say(f"contact    radius {result.contact_radius_m * 1e3:.3f} mm")
    say(f"pressure   {result.max_pressure_pa * 1e-3:.1f} kPa at most")
    say(f"balance    {result.force_balance_relative:.1e} of the force")
    say(f"gap        {result.gap_min_m * 1e6:.3f} um at least, det F {result.min_jacobian:.3f}")
    say(f"mesh       {result.element}, {result.tet_count} tetrahedra, {result.node_count} nodes")
    say(f"force error believed to be {believed}: {result.estimated_force_error_basis}")
    say(f"time       {sum(result.wall_s.values()):.2f} s, {result.newton_iterations} iterations")


def _show_interfaces(result: PressResult) -> None:
    """Say what goes through where layers meet; nothing for a gel of one material."""
    if result.point is None:
        return
    found = interface_traction(result.model, result.point.state.positions)
    for number, interface in enumerate(found, start=1):
        gap = abs(interface.force_n[2] - result.force_n[2])
        say(
            f"interface  {number}: {interface.force_n[2]:.4f} N go through, {gap:.1e} N from the "
            f"indenter's; tractions below and above differ by {interface.jump_relative:.0%}"
        )
