"""``tacauchy-rig plan``: which effects a scene calls for, and what leaving the others out costs."""

from __future__ import annotations

from dataclasses import asdict, replace

from sim.effects.estimates import expected_depth
from sim.effects.mesh_choice import mesh_choice
from sim.effects.plan import plan_effects
from sim.error.measured_errors import FAST, setting_of
from sim.error.prior_error import is_measured, time_ratio
from sim.error.tolerance import alternatives, expected_error
from tacauchy_rig.cli.cost_lines import cost_lines
from tacauchy_rig.cli.options import JsonFile
from tacauchy_rig.cli.output import say, write_json
from tacauchy_rig.cli.scene_command import states_a_scene
from tacauchy_rig.cli.scene_options import OutputOption, SceneTerms, scene_of


@states_a_scene
def plan(terms: SceneTerms, output: OutputOption = None, json_file: JsonFile = None) -> None:
    """Say what a press would be simulated with, and why; nothing is pressed."""
    scene = scene_of(replace(terms, outputs=tuple(output or ())))
    planned = plan_effects(scene)
    choice = mesh_choice(scene)
    for row in planned.effects:
        error = "" if row.estimated_error is None else f"{row.estimated_error:.2e}"
        say(f"{row.effect.value:21} {'on' if row.on else 'off':4} {error:9} {row.reason}")
    say(f"preset: {setting_of(scene)}")
    say(f"mesh: {choice.kind.value}: {choice.reason}")
    say(f"left out together: {planned.estimated_error:.2e} of {planned.tolerance:.2e} allowed")
    depth = expected_depth(scene)
    believed, basis = expected_error(scene, planned, depth_m=depth)
    others = alternatives(scene, depth_m=depth, wall_s=None)
    setting = setting_of(scene)
    ratio = time_ratio(setting, FAST) if is_measured(setting) else None
    cost = "not known" if ratio is None else f"about {ratio:.2g} times the time of preset fast"
    for line in cost_lines(believed, basis, cost, others):
        say(line)
    write_json(
        json_file,
        {
            "preset": str(setting_of(scene)),
            "effects": planned.as_json(),
            "mesh": {"kind": choice.kind.value, "reason": choice.reason},
            "tolerance": planned.tolerance,
            "estimated_error": planned.estimated_error,
            "force_error_relative": believed,
            "force_error_basis": basis,
            "time_over_fast": ratio,
            "alternatives": [asdict(other) for other in others],
        },
    )
