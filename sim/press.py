"""One simulated press: from a scene to forces, contact and their estimated errors."""

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np

from sim.cheapest_setting import alternatives, setting_of
from sim.effects.effect_choice import plan_effects
from sim.effects.planned_effects import EffectPlan
from sim.effects.press_outputs import outputs_of
from sim.effects.press_with_effects import EndState, end_state, on_own_mesh
from sim.error_estimate import NOT_ASKED, ErrorEstimate, estimated, guaranteed
from sim.fields.pressure_and_shear import SurfaceTraction, contact_measures, surface_traction
from sim.fields.stress import surface_stress
from sim.mesh.elements import ElementOrder
from sim.mesh_bias_correction import Corrected, correction
from sim.scene.scene import Scene
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.errors import ConvergenceError
from tacauchy_rig.core.simulated import Alternative
from tacauchy_rig.core.time_limit_and_progress import doing, time_limit, told

# The paper's two algorithms are at most 20 and 36 % apart in presses whose force is right, under
# sharp corners; where an indenter had passed through, many times that.
_GAP_MOST, _APART_MOST = 0.5, 1.0
# Where gel at a rim is flat or inside out, the L2 norm may be more: the force is known to the gap.
_GAP_AT_RIM = 0.15


@dataclass(frozen=True, slots=True, kw_only=True)
class PressResult:
    """The result of a press; ``as_json`` has the same keys.

    Attributes:
        force_n: Force on the indenter [N], pad frame, +z in compression.
        moment_nm: Moment on the indenter about its tip [N m].
        depth_m: Travel below first touch [m].
        contact_area_m2: Deformed area of the surface within d_hat of the indenter [m^2].
        contact_radius_m: Radius of the disc of the same area seen along z [m].
        max_pressure_pa: Largest contact pressure at a node, recovered as the fields are [Pa]; at a
            sharp rim it grows with refinement.
        base_reaction_n: Force of the clamp on the gel [N], shape [3]; z is positive.
        force_balance_relative: |force + base reaction - weight| over |force|. With inertia it
            includes the force that accelerates the gel.
        surface_traction_gap_relative: |integral of sigma n over the faces in contact + force| over
            |force|, with the elements' own stress sigma (paper, Algorithm 1).
        algorithms_apart_relative: L1 norm, over the faces in contact, of the difference between
            the tractions of the paper's Algorithms 1 (sigma n) and 2 (contact forces), over that
            of the latter; at a sharp rim the L2 norm has no limit.
        min_jacobian: Smallest volume ratio det F at a quadrature point.
        gap_min_m: Smallest gap at a contact point [m].
        estimated_force_error_relative: Expected relative error of F_z, or None where nothing is
            known; ``estimated_force_error_basis`` says how.
        estimated_errors: Expected relative error of every output, by name; that of shear is
            relative to the pressure.
        corrected: Force and depth corrected for the mesh's known error, unlike ``force_n`` and
            ``depth_m``; None where it is not known (docs/explanation/accuracy.md).
        guaranteed: The quantity that a tolerance holds for: the force at a given depth, or the
            depth at a given force.
        guaranteed_error_relative: Stated error of that quantity, corrected where possible; None
            where nothing is known.
        effects: Effects that were simulated and left out, with reasons.
        preset: Preset or mesh between two presets.
        way: Loading path on its mesh, with all states; None unless they were to be kept.
        alternatives: The next cheaper settings and the next better ones.
    """

    force_n: tuple[float, float, float]
    moment_nm: tuple[float, float, float]
    depth_m: float
    contact_area_m2: float
    contact_radius_m: float
    max_pressure_pa: float
    base_reaction_n: tuple[float, float, float]
    force_balance_relative: float
    surface_traction_gap_relative: float
    algorithms_apart_relative: float
    min_jacobian: float
    gap_min_m: float
    newton_iterations: int
    wall_s: dict[str, float]
    element: str
    node_count: int
    tet_count: int
    mesh: str
    mesh_hash: str
    estimated_force_error_relative: float | None
    estimated_force_error_basis: str
    estimated_errors: dict[str, float]
    corrected: Corrected | None
    guaranteed: str
    guaranteed_error_relative: float | None
    effects: list[dict[str, Any]]
    preset: str
    alternatives: tuple[Alternative, ...]
    model: Model = field(repr=False)
    point: PathPoint = field(repr=False)
    way: LoadingPath | None = field(default=None, repr=False)

    def as_json(self) -> dict[str, Any]:
        """Return plain values for ``--json``, units in the keys."""
        plain = {each.name: getattr(self, each.name) for each in fields(self) if each.repr}
        corrected = None if self.corrected is None else asdict(self.corrected)
        others = [asdict(each) for each in self.alternatives]
        return {**plain, "corrected": corrected, "alternatives": others}


def press(
    scene: Scene,
    *,
    model: Model | None = None,
    device: str = "cpu",
    estimate_error: bool = False,
    keeps_states: bool = False,
    time_limit_s: float | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> PressResult:
    """Simulate the press of a scene.

    Args:
        model: Model of the pad; None builds it from the scene.
        device: ``"cpu"``, or a GPU such as ``"cuda:0"``.
        estimate_error: Press again on a coarser mesh to estimate the errors of all outputs.
        keeps_states: Keep all states of the loading path, in ``way``.
        time_limit_s: Longest time [s]. A result found within it is returned even if its errors
            are not estimated yet.
        on_progress: Called by another thread every few seconds with a line of text.

    Raises:
        ConvergenceError: No equilibrium exists, the force cannot be reached, or the result
            contradicts itself.
        ConfigError: The scene cannot be built, or the gel cannot bear the press.
        TimeLimitError: No result was found in time.
    """
    telling = told(on_progress) if on_progress else nullcontext()
    with time_limit(time_limit_s), telling, doing("press"):
        started = time.perf_counter()
        plan = plan_effects(scene)
        end = end_state(scene, plan, model=model, device=device, keeps_all=keeps_states)
        try:
            result = _judged(scene, plan, end, started=started, asks=estimate_error)
        except ConvergenceError:
            if end.way_path is None:
                raise
            # Load steps on its own mesh may end in a fold that contradicts nothing.
            end = on_own_mesh(scene, plan, end, keeps_all=keeps_states)
            result = _judged(scene, plan, end, started=started, asks=estimate_error)
        return replace(result, way=end.way_path or end.path) if keeps_states else result


def _judged(
    scene: Scene, plan: EffectPlan, end: EndState, *, started: float, asks: bool
) -> PressResult:
    """Evaluate an end state; errors are estimated where that is asked for."""
    path, point, solve_s = end.path, end.point, end.path.counts.wall_s
    wall = {"setup": time.perf_counter() - started - solve_s, "solve": solve_s}
    error, started, found = NOT_ASKED, time.perf_counter(), outputs_of(path, point)
    if asks:
        error = estimated(scene, plan, found, way=end.way)
        wall["estimate"] = time.perf_counter() - started
    corrected = correction(scene, plan, found, end.way) if end.way_path else None
    if not end.way_path:
        scene = replace(scene, path_refinement=None)
    return measure(scene, path, point, plan=plan, wall_s=wall, error=error, corrected=corrected)


def measure(
    scene: Scene,
    path: LoadingPath,
    point: PathPoint,
    *,
    plan: EffectPlan,
    wall_s: dict[str, float],
    error: ErrorEstimate = NOT_ASKED,
    corrected: Corrected | None = None,
) -> PressResult:
    """Evaluate an equilibrium.

    Raises:
        ConvergenceError: The gel's stress and the indenter's force contradict each other, or no
            error is known of so deep a press.
    """
    model = path.model
    contact, recovered = contact_measures(model, point), surface_traction(model, point)
    reaction = -model.mesh.symmetry.whole_force(
        point.equilibrium.elastic_gradient[model.clamped].sum(axis=0)
    )
    balance = float(np.linalg.norm(point.force_n + reaction + path.body_force_n(point)))
    size = float(np.linalg.norm(point.force_n))
    traction_gap, apart, apart_l2 = stress_gaps(model, point, recovered)
    many = point.depth_m > model.contact_options.distance_m  # not a few points of a face
    at_rim = many and apart_l2 > _APART_MOST and model.reference.order is ElementOrder.P2
    most = _GAP_AT_RIM if at_rim and corrected else _GAP_MOST
    _refuse_gap(model, point, traction_gap, apart, most)
    if corrected is not None and at_rim:
        corrected = replace(
            corrected,
            error_relative=corrected.error_relative + traction_gap,
            basis=f"{corrected.basis}; {traction_gap:.2%} added (force gap)",
        )
    ratio_min, judged = point.equilibrium.min_jacobian, guaranteed(scene)
    error = error.beyond_rules(scene, point.depth_m, traction_gap, ratio_min, at_rim=at_rim)
    stated = error.relative.get(judged) if corrected is None else corrected.error_relative
    as_stated = scene if corrected else replace(scene, path_refinement=None)
    return PressResult(
        force_n=tuple(point.force_n.tolist()),
        moment_nm=tuple(contact.moment_nm.tolist()),
        depth_m=point.depth_m,
        contact_area_m2=contact.area_m2,
        contact_radius_m=float(np.sqrt(contact.area_seen_m2 / np.pi)),
        max_pressure_pa=float(recovered.pressure_pa.max()),
        base_reaction_n=tuple(reaction.tolist()),
        force_balance_relative=balance / size if size > 0.0 else 0.0,
        surface_traction_gap_relative=traction_gap,
        algorithms_apart_relative=apart,
        min_jacobian=ratio_min,
        gap_min_m=contact.gap_min_m,
        newton_iterations=path.counts.newton_iterations,
        wall_s=wall_s,
        element=model.reference.order.value,
        node_count=len(model.nodes),
        tet_count=len(model.elements),
        mesh=model.mesh.name,
        mesh_hash=model.mesh.content_hash,
        estimated_force_error_relative=error.force,
        estimated_force_error_basis=error.basis,
        estimated_errors={output.value: relative for output, relative in error.relative.items()},
        corrected=corrected,
        guaranteed=judged.value,
        guaranteed_error_relative=stated,
        effects=plan.as_json(),
        preset=str(setting_of(scene)),
        alternatives=alternatives(as_stated, stated, wall_s=sum(wall_s.values()), judged=judged),
        model=model,
        point=point,
    )


def _refuse_gap(model: Model, point: PathPoint, gap: float, apart: float, most: float) -> None:
    """End where the gel's stress tells another force than the contact; linear elements may."""
    few = point.depth_m <= model.contact_options.distance_m  # points of a face touch
    if few or model.reference.order is not ElementOrder.P2:
        return
    if gap > most or apart > _APART_MOST:
        raise ConvergenceError(
            f"the gel's stress and the indenter's force of {point.force_n[2]:.4f} N at "
            f"{point.depth_m * 1e3:.4f} mm contradict each other: the sum of the tractions is "
            f"{gap:.0%} off the force, their field {apart:.0%} off that of the contact",
            remedy="press less deep, give the indenter a fillet, or take a finer --preset",
        )


def stress_gaps(model: Model, point: PathPoint, recovered: SurfaceTraction) -> tuple[float, ...]:
    """Return how far sigma n on the surface misses the indenter's force, and Algorithm 2.

    As ``PressResult`` has them, and the latter in the L2 norm; zero where nothing touches.
    """
    touching = np.any(point.equilibrium.contact.forces != 0.0, axis=(1, 2))
    if not touching.any():
        return 0.0, 0.0, 0.0
    stress = surface_stress(model, point.state.positions)
    own, areas = stress.traction_pa[touching], stress.areas_m2[touching]
    missing = model.mesh.symmetry.whole_force(areas @ own) + point.force_n
    vectors = model.surface.area_vectors(point.state.positions)[touching]
    shares = np.linalg.norm(vectors, axis=2) @ model.reference.face_values
    nodal = recovered.traction_pa[model.faces[touching]]
    contact = np.einsum("fk,fki->fi", shares, nodal) / areas[:, None]
    away, size = (np.linalg.norm(each, axis=1) for each in (own - contact, contact))
    norms = [(areas @ away**k / max(areas @ size**k, 1e-300)) ** (1.0 / k) for k in (1, 2)]
    return float(np.linalg.norm(missing) / np.linalg.norm(point.force_n)), *map(float, norms)
