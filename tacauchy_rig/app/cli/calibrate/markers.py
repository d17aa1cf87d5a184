"""``tacauchy-rig calibrate markers``: the cheap marker motion fitted to the simulated one."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from sim.scene.scene import ContactMode, Motion, Preset, Target
from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import say, write_json
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import Dimension, parse_quantity


def markers(
    sensor: Annotated[str, typer.Option("--sensor", help="A sensor with markers.")],
    indenter: Annotated[
        str, typer.Option("--indenter", help="Such as sphere:diameter=8mm.")
    ] = "sphere:diameter=8mm",
    depth: Annotated[str, typer.Option("--depth", help="Of the press.")] = "0.8mm",
    shift: Annotated[str, typer.Option("--shift", help="Along x, once pressed in.")] = "0.3mm",
    twist: Annotated[str, typer.Option("--twist", help="About z, once pressed in.")] = "8deg",
    friction: Annotated[float, typer.Option("--friction", help="Coulomb's mu.")] = 0.8,
    preset: Annotated[Preset, typer.Option("--preset")] = Preset.FAST,
    json_file: JsonFile = None,
) -> None:
    """Press, shear and twist in the simulator, and fit the FOTS exponentials to the markers.

    Example: tacauchy-rig calibrate markers --sensor markers.toml --depth 0.5mm
    """
    from sim.optics.markers.fots import compare_marker_fidelities
    from sim.scene.terms import parse_indenter
    from sim.sensor.sensor import load_sensor

    known = load_sensor(sensor)
    if known.markers is None:
        raise ConfigError(
            f"sensor {known.name} has no markers", remedy="give a sensor file with [markers]"
        )
    press_depth, slide = (
        parse_quantity(text, dimension=Dimension.LENGTH, field=field)
        for text, field in ((depth, "--depth"), (shift, "--shift"))
    )
    turn = parse_quantity(twist, dimension=Dimension.ANGLE, field="--twist")
    rubs = {"contact": ContactMode.FRICTION, "friction": friction, "preset": preset}
    scene = known.scene(parse_indenter(indenter), Target(depth_m=press_depth), **rubs)
    motions = {
        "press": Motion(),
        "shear": Motion(shift_m=(slide, 0.0)),
        "twist": Motion(twist_rad=turn),
    }
    fitted, found = compare_marker_fidelities(scene, motions, known.markers, known.camera)
    say("motion   largest    exponentials off       tracked off            markers")
    for name, row in found.items():
        say(
            f"{name:8} {row.largest_m * 1e3:.3f} mm   {row.difference_rms_m * 1e3:.3f} rms, "
            f"{row.difference_largest_m * 1e3:.3f} mm   {row.tracking_rms_px:.3f} rms, "
            f"{row.tracking_largest_px:.3f} px   {row.tracked} tracked, {row.lost} lost"
        )
    for name, value in asdict(fitted).items():
        say(f"{name:14} {value:.4g}{' 1/m^2' if name.endswith('decay') else ''}")
    write_json(json_file, {"fitted": fitted, "motions": found})
