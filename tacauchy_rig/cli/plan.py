"""``tacauchy-rig plan``: which effects a scene calls for, and what leaving the others out costs."""

from __future__ import annotations

from sim.effects import plan_effects
from sim.laws.catalogue import LawName
from sim.mesh_choice import mesh_choice
from tacauchy_rig.cli.options import JsonFile
from tacauchy_rig.cli.output import say, write_json
from tacauchy_rig.cli.scene_options import (
    AtOption,
    ContactOption,
    DepthOption,
    DurationOption,
    EffectOption,
    ForceOption,
    IndenterOption,
    LawOption,
    LayerOption,
    MeshOption,
    OutputOption,
    PadOption,
    PoissonOption,
    PresetOption,
    SceneTerms,
    SensorOption,
    ShiftOption,
    TiltOption,
    ToleranceOption,
    TwistOption,
    YoungOption,
    scene_of,
)


def plan(
    indenter: IndenterOption,
    sensor: SensorOption = None,
    pad: PadOption = None,
    depth: DepthOption = None,
    force: ForceOption = None,
    at: AtOption = None,
    shift: ShiftOption = None,
    twist: TwistOption = None,
    tilt: TiltOption = None,
    young: YoungOption = None,
    poisson: PoissonOption = None,
    layer: LayerOption = None,
    law: LawOption = LawName.STABLE_NEO_HOOKEAN,
    contact: ContactOption = "frictionless",
    duration: DurationOption = None,
    preset: PresetOption = None,
    mesh: MeshOption = None,
    tolerance: ToleranceOption = None,
    effect: EffectOption = None,
    output: OutputOption = None,
    json_file: JsonFile = None,
) -> None:
    """Say what a press would be simulated with, and why; nothing is pressed."""
    scene = scene_of(
        SceneTerms(
            indenter=indenter,
            sensor=sensor,
            pad=pad,
            depth=depth,
            force=force,
            at=at,
            shift=shift,
            twist=twist,
            tilt=tilt,
            young=young,
            poisson=poisson,
            layers=layer or [],
            law=law,
            contact=contact,
            duration=duration,
            preset=preset,
            mesh=mesh,
            tolerance=tolerance,
            effects=effect or [],
            outputs=output or [],
        )
    )
    planned = plan_effects(scene)
    choice = mesh_choice(scene)
    for row in planned.effects:
        error = "" if row.estimated_error is None else f"{row.estimated_error:.2e}"
        say(f"{row.effect.value:21} {'on' if row.on else 'off':4} {error:9} {row.reason}")
    say(f"preset: {scene.preset}")
    say(f"mesh: {choice.kind.value}: {choice.reason}")
    say(f"left out together: {planned.estimated_error:.2e} of {planned.tolerance:.2e} allowed")
    write_json(
        json_file,
        {
            "preset": scene.preset.value,
            "effects": planned.as_json(),
            "mesh": {"kind": choice.kind.value, "reason": choice.reason},
            "tolerance": planned.tolerance,
            "estimated_error": planned.estimated_error,
        },
    )
