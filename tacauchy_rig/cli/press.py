"""``tacauchy-rig press``: one simulated press, stated on the command line."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import typer

from sim.indenter import describe
from sim.laws import paper_eq4
from sim.laws.catalogue import LawName
from sim.pad import Pad
from sim.press import PressResult
from sim.press import press as simulate_press
from sim.scene import Material, Preset, Scene, Target
from sim.sensor import load_sensor
from tacauchy_rig.cli.options import JsonFile
from tacauchy_rig.cli.output import complain, say, write_json
from tacauchy_rig.cli.press_terms import parse_contact, parse_indenter, parse_pad
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
    law: Annotated[LawName, typer.Option("--law")] = LawName.STABLE_NEO_HOOKEAN,
    contact: Annotated[
        str, typer.Option("--contact", help="frictionless or bonded.")
    ] = "frictionless",
    preset: Annotated[Preset, typer.Option("--preset")] = Preset.BALANCED,
    json_file: JsonFile = None,
) -> None:
    """Press once in the simulator and say what it took."""
    place, material = _pad_and_material(sensor, pad, young, poisson)
    scene = Scene(
        pad=place,
        material=replace(material, law=law),
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
    write_json(json_file, result.as_json())


def _pad_and_material(
    sensor: str | None, pad: str | None, young: str | None, poisson: float | None
) -> tuple[Pad, Material]:
    if (sensor is None) == (pad is None):
        raise ConfigError("press needs either --sensor or --pad", remedy="give exactly one")
    modulus = (
        None
        if young is None
        else parse_quantity(young, dimension=Dimension.PRESSURE, field="--young").value
    )
    if sensor is not None:
        known = load_sensor(sensor)
        return known.pad, Material(
            young_pa=known.material.young_pa if modulus is None else modulus,
            poisson=known.material.poisson if poisson is None else poisson,
        )
    if pad is None or modulus is None or poisson is None:
        raise ConfigError(
            "--pad has no material of its own", remedy="give --young and --poisson too"
        )
    return parse_pad(pad), Material(young_pa=modulus, poisson=poisson)


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
