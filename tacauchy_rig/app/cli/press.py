"""``tacauchy-rig press`` and ``plan``: simulate a scene of the command line, or plan it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sim.scene.material import LawName, Material
from sim.scene.scene import Drive, Output, Preset, Scene, SceneTerms
from tacauchy_rig.app.cli.output import Found, JsonFile, complain, say, show_table, write_json
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import Dimension, parse_quantity
from tacauchy_rig.core.tables import table_of
from tacauchy_rig.core.time_limit_and_progress import doing
from tacauchy_rig.core.time_limit_and_progress import time_limit as limited_to

if TYPE_CHECKING:
    from sim.press import PressResult
    from tacauchy_rig.core.simulated import Alternative


OutputOption = Annotated[
    list[Output] | None,
    typer.Option(
        "--output",
        metavar="OUTPUT",
        help=f"An output that gets a stated error: {', '.join(Output)}; may be repeated.",
    ),
]


class StatedScene(SceneTerms):
    """A scene that options state."""

    __doc__ = f"""A scene.

    Args:
        indenter: cylinder:diameter= (and ,fillet=), sphere:diameter=, plane or mesh:FILE (and
            ,unit=,edge=).
        sensor: Sensor by name or TOML file.
        pad: box:LxWxHmm, disc:radius=,height= or mesh:FILE,unit=mm
        depth: Depth below first touch, such as 0.5mm.
        force: Force to press to, such as 4.7332N.
        at: Position of the tip on the pad, such as 1,0.5mm.
        shift: Motion after the press: along x, or x and y as in 0.3,0.1mm.
        twist: Turn about z after the press, such as 5deg.
        tilt: Tilt of the indenter about x and y, such as 2,0deg.
        young: Young's modulus, such as 0.3MPa.
        poisson: Poisson's ratio, such as 0.48.
        layer (LAYER): share=, young= and poisson=, joined by commas; one for each layer, from the
            base up.
        law (LAW): One of {", ".join(LawName)}, or another package's.
        contact: frictionless, bonded or friction:MU.
        duration: Duration of the press; 1 s if absent.
        preset (PRESET): {", ".join(Preset)}; balanced, unless --tolerance chooses one.
        mesh (NAME=X,): Settings of fTetWild, for scenes that it meshes: l_r=, epsilon_r=,
            stop_energy=, dihedral_min=; those left out are the preset's.
        tolerance (2%): 0.02N or 2%: take the cheapest meshes that keep the error of the corrected
            F_z within it (with --force: of the depth). With --preset it only decides which effects
            are left out. For other outputs add shear=5% and the like, joined by commas.
        effect (NAME=on): Switch an effect NAME=on or NAME=off against the plan; may be repeated.
        drive (DRIVE): How a force is reached: {" or ".join(Drive)}.
    """


def press(
    terms: StatedScene,
    *,
    device: str = "cpu",
    estimate_error: Annotated[bool, typer.Option("--estimate-error/--no-estimate-error")] = True,
    time_limit: str | None = None,
    output: OutputOption = None,
    json_file: JsonFile = None,
    out: Path | None = None,
    optics: str = "",
    background: Path | None = None,
) -> None:
    """Simulate one press; print force, depth, their errors and the cost.

    Example: tacauchy-rig press --sensor gelsight-mini --indenter sphere:diameter=8mm --force 2N

    Args:
        device: Where the kernels run: cpu or cuda:0.
        estimate_error: Press again on a coarser mesh to estimate the error of the outputs.
        time_limit (TIME): Longest time, such as 60s or 5min.
        out (FOLDER): Write there what a replay writes: fields (npz, VTU), the gel's stress, the
            indenter, a figure; of a sensor its image, height map and markers too.
        optics (FILE): Calibration of the image; else nominal lamps.
        background: No-contact frame of the image; else evenly grey.
    """
    from sim.device import warp_device
    from sim.press import press as simulate_press
    from sim.press_arguments import scene_of, tolerances_of

    # What is written is asked for.
    terms = replace(terms, output=tuple(output or ()) if out is None else tuple(Output))
    with limited_to(_seconds(time_limit)):
        scene = scene_of(terms)
        images = _optics_for(scene, out, optics, background)
        if terms.law == LawName.PAPER_EQ4:
            _warn_of_rest_stress(scene.material)
        result = simulate_press(
            scene,
            device=warp_device(device),
            estimate_error=estimate_error,
            keeps_states=out is not None,
        )
    kept = None if terms.preset else tolerances_of(terms.tolerance)[0]
    _show(scene, result, None if kept is None else kept.of(result.force_n[2]))
    _show_interfaces(result)
    write_json(json_file, result.as_json())
    if out is not None:
        from tacauchy_rig.app.replay.press_folder import write_press

        write_json(out / "press.json", result.as_json())
        with doing("writing fields and figures"):
            paths = list(write_press(out, scene, result, images))
        for path in paths:
            say(f"wrote      {path}")
        if not scene.sensor:
            say("no image, height map or markers: a bare pad has no camera; name a --sensor")


def plan(terms: StatedScene, output: OutputOption = None) -> Found:
    """Print mesh and effects that a press would be simulated with, and why.

    Example: tacauchy-rig plan --sensor gelsight-mini --indenter sphere:diameter=8mm --force 2N
    """
    from sim.cheapest_setting import alternatives, costs_of, setting_of
    from sim.effects.effect_choice import plan_effects
    from sim.effects.mesh_choice import mesh_choice
    from sim.error_estimate import guaranteed
    from sim.press_arguments import scene_of

    scene = scene_of(replace(terms, output=tuple(output or ())))
    planned = plan_effects(scene)
    kind, why = mesh_choice(scene)
    show_table(
        table_of(
            list(planned.rows.values()),
            {
                "effect": lambda row: row.effect.value,
                "is": lambda row: "on" if row.on else "off",
                "costs": lambda row: (
                    None if row.estimated_error is None else f"{row.estimated_error:.2e}"
                ),
                "because": lambda row: row.reason,
            },
        )
    )
    say(f"preset: {setting_of(scene)}")
    say(f"mesh: {kind.value}: {why}")
    for each, most in planned.tolerances.items():
        say(f"left out together: {planned.left_out(each):.2e} of {most:.2e} allowed of {each}")
    say(f"trying took {planned.tried_s:.2f} s of the processor")
    judged = guaranteed(scene)
    others = alternatives(scene, None, wall_s=None, judged=judged)
    worth = costs_of(scene).get(setting_of(scene))
    about = worth and f"about {worth.time_ratio:.2g} times the time of preset fast"
    say(f"cost       {about or 'not known'}; `press` estimates the error of its {judged.value}")
    for other in others:
        say(f"{other.role:10} {other}")
    return Found(
        {
            "preset": str(setting_of(scene)),
            "effects": planned.as_json(),
            "mesh": {"kind": kind.value, "reason": why},
            "tolerances": {each.value: share for each, share in planned.tolerances.items()},
            "left_out": {each.value: planned.left_out(each) for each in planned.tolerances},
            "tried_s": planned.tried_s,
            "time_over_fast": worth and worth.time_ratio,
            "alternatives": [asdict(other) for other in others],
        }
    )


def _optics_for(scene: Scene, out: Path | None, optics: str, background: Path | None) -> Any:
    """Read how the image is to be made, before anything is simulated; None where none is made."""
    if out is not None and scene.sensor:
        from tacauchy_rig.app.replay.press_folder import optics_for

        return optics_for(scene, optics, background)
    if optics or background is not None:
        raise ConfigError(
            "--optics and --background are of an image, and none is made",
            remedy="give --sensor and --out too, or leave them out",
        )
    return None


def _seconds(text: str | None) -> float | None:
    """Read ``--time-limit`` [s]."""
    if text is None:
        return None
    limit_s: float = parse_quantity(text, dimension=Dimension.TIME, field="--time-limit")
    if not limit_s > 0.0:
        raise ConfigError(f"--time-limit {text} leaves no time", remedy="give a time above 0 s")
    return limit_s


def cost_lines(
    error_relative: float | None,
    basis: str,
    cost: str,
    others: Sequence[Alternative],
    *,
    quantity: str = "force",
) -> Iterator[str]:
    """Return lines on the estimated error, the cost, and the next cheaper and better settings.

    Args:
        basis: How the error is known, or why not.
        cost: Of the settings used.
        quantity: Whose error it is, in words.
    """
    error = "not known" if error_relative is None else f"{error_relative:.1%}"
    yield f"{quantity} estimated error {error}: {basis}"
    yield f"cost       {cost}"
    for other in others:
        yield f"{other.role:10} {other}"
    if not others:
        yield "no neighbours: nothing was measured with these settings"


def _warn_of_rest_stress(material: Material) -> None:
    from sim.material.laws import paper_eq4

    stress = paper_eq4.LAW.rest_stress(material.young_pa, material.poisson)
    shrink = 1.0 - paper_eq4.free_stretch(material.poisson)
    complain(
        f"warning: law {LawName.PAPER_EQ4} is the paper's Eq. 4 as printed. It has a tension of "
        f"{stress * 1e-3:.1f} kPa at rest; a free gel would shrink by {shrink:.1%} per axis. The "
        "pad is first solved without the indenter, and depth counts from touching that shape."
    )


def _show(scene: Scene, result: PressResult, allowed: float | None) -> None:
    from sim.scene.indenter import describe

    say(f"{describe(scene.indenter)}, {scene.contact.value}, preset {result.preset}")
    corrected = result.corrected
    if corrected is None:
        say(f"force      {result.force_n[2]:.4f} N at {result.depth_m * 1e3:.4f} mm")
    else:
        say(f"corrected  {corrected.force_n:.4f} N at {corrected.depth_m * 1e3:.4f} mm")
        say(f"raw        {result.force_n[2]:.4f} N at {result.depth_m * 1e3:.4f} mm")
    if not scene.motion.is_straight:
        say(f"           {result.force_n[0]:.4f} N along x, {result.force_n[1]:.4f} N along y")
        say(f"moment     {result.moment_nm[2] * 1e3:.4f} N mm about z")
    say(f"contact    radius {result.contact_radius_m * 1e3:.3f} mm")
    say(f"pressure   {result.max_pressure_pa * 1e-3:.1f} kPa at most")
    say(f"balance    {result.force_balance_relative:.1e} of the force")
    say(f"force gap  {result.surface_traction_gap_relative:.1%} between sigma n and the force")
    apart = result.algorithms_apart_relative
    say(f"fields     {apart:.1%} between tractions from sigma n and from contact")
    say(f"gap        {result.gap_min_m * 1e6:.3f} um at least, det F {result.min_jacobian:.3f}")
    if result.min_jacobian <= 0.0:
        complain(
            f"warning: the gel is inside out somewhere (det F {result.min_jacobian:.3f}); fields "
            "there mean nothing, and F_z may be further off than stated. Press less deep, give the "
            "indenter a fillet, or take a finer --preset."
        )
    say(f"mesh       {result.element}, {result.tet_count} tetrahedra, {result.node_count} nodes")
    off = [row["name"] for row in result.effects if not row["on"]]
    say(f"left out   {', '.join(off)}; `tacauchy-rig plan` with the same options explains why")
    cost = f"{sum(result.wall_s.values()):.2f} s, {result.newton_iterations} iterations"
    basis = result.estimated_force_error_basis if corrected is None else corrected.basis
    given = f"{result.depth_m * 1e3:.4g} mm" if result.guaranteed == "force" else "that force"
    quantity = f"{result.guaranteed} at {given}:"
    error, neighbours = result.guaranteed_error_relative, result.alternatives
    for line in cost_lines(error, basis, cost, neighbours, quantity=quantity):
        say(line)
    if allowed and error and error > allowed:
        complain(
            f"warning: the stated error of the {result.guaranteed}, {error:.2%}, is above the "
            f"tolerance, {allowed:.2%}; a smaller --tolerance takes finer meshes"
        )
    others = ", ".join(
        f"{name} {share:.1%}{' of pressure' * (name == Output.SHEAR)}"
        for name, share in result.estimated_errors.items()
        if name not in {Output.FORCE, Output.DEPTH}
    )
    if others:
        say(f"errors     {others}")


def _show_interfaces(result: PressResult) -> None:
    """Say what goes through where layers meet; nothing for a gel of one material."""
    from sim.fields.stress import interface_traction

    found = interface_traction(result.model, result.point.state.positions)
    for number, interface in enumerate(found, start=1):
        gap = abs(interface.force_n[2] - result.force_n[2])
        say(
            f"interface  {number}: {interface.force_n[2]:.4f} N go through, {gap:.1e} N from the "
            f"indenter's; tractions below and above differ by {interface.element.jump_relative:.0%}"
        )
