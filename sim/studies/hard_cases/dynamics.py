"""Cases 6, 9, 10 and 11: time steps, stick and slip, impacts, and a pad turned half round."""

from itertools import pairwise, product

import numpy as np

from sim.fields.pressure_and_shear import contact_measures
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Indenter, Plane, Sphere
from sim.scene.pad import DiscPad
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from sim.solve.weight_and_inertia import Inertia
from sim.studies.hard_cases import small_pads
from sim.studies.hard_cases.small_pads import Measured
from sim.studies.modes.contact_signature import contact_signature
from tacauchy_rig.core.arrays import FloatArray

FRICTION = 0.5
SLIP_M = 1e-7
# IPC's default (Li et al. 2020): sticking is slower than 1e-3 of the scene's size a second.
EPS_V_M_S = 1e-3 * 2.0 * small_pads.DISC.radius_m
SPEED_M_S = 1e-3


def stick_slip(*, step_m: float = 40e-6, step_count: int = 10, hold_count: int = 5) -> Measured:
    """Drag a pressed ball to and fro in steps; hold it still in between.

    Creep is the motion along the indenter of points that stick, in one step.
    """
    mesh = small_pads.round_mesh(start_m=0.0, end_m=1.7e-3, size_m=0.5e-3, symmetric=False)
    model = small_pads.pad_model(mesh, friction=FRICTION, slip_m=SLIP_M)
    path = LoadingPath(model, Sphere(diameter_m=10e-3))
    back_and_forth = ((1, 1), (0, hold_count), (1, step_count), (0, hold_count), (-1, step_count))
    moves = [sign * step_m for sign, count in back_and_forth for _ in range(count)]
    points = [path.advance(0.3e-3), *(path.carry(shift_m=(move, 0.0)) for move in moves)]
    steps = np.array([_drag_step(path, *pair) for pair in pairwise(points)])
    dragged = np.array(moves) != 0.0
    shares = steps[dragged, 3].tolist()
    return {
        "steps": len(moves),
        "excess_over_friction_limit_relative": float(steps[:, 0].max()),
        "creep_m": float(steps[dragged, 1].max()),
        "creep_held_still_m": float(steps[~dragged, 2].max()),
        "eps_v_dt_m": EPS_V_M_S * step_m / SPEED_M_S,
        "stuck_share_min": min(shares),
        "stuck_share_max": max(shares),
        "newton_iterations": path.counts.newton_iterations,
    }


def _drag_step(path: LoadingPath, before: PathPoint, point: PathPoint) -> tuple[float, ...]:
    """Return what one step of a drag did.

    Returns:
        Tangential over normal forces over mu, less one; how far a point that sticks moved along
        the indenter, and any that touches, at most [m]; the share of touching points that stick.
    """
    old, new = small_pads.grip_of(before), small_pads.grip_of(point)
    touching = (old.held > 0.0) & (new.held > 0.0)
    stuck = touching & np.all(old.anchors == new.anchors, axis=2)
    slip = _along_indenter(path, before, point)
    return (
        contact_signature(path.model, point).sliding_friction / FRICTION - 1.0,
        float(slip[stuck].max(initial=0.0)),
        float(slip[touching].max(initial=0.0)),
        float(stuck.sum() / max(touching.sum(), 1)),
    )


def _along_indenter(path: LoadingPath, before: PathPoint, after: PathPoint) -> FloatArray:
    """Return how far every contact point moved along the indenter [m], shape [f, p]."""
    values, faces = path.model.reference.face_values, path.model.faces
    start, motion = (
        (values @ point.state.positions[faces] - point.state.tip) @ point.state.rotation
        for point in (before, after)
    )
    motion -= start
    loads = small_pads.grip_of(after).loads
    normals = loads / np.maximum(np.linalg.norm(loads, axis=2, keepdims=True), 1e-300)
    motion -= np.einsum("fpx,fpx->fp", motion, normals)[..., None] * normals
    return np.asarray(np.linalg.norm(motion, axis=2))


def torsion(*, turn_deg: float = 180.0, step_deg: float = 10.0) -> Measured:
    """Turn a plate that sticks to the whole face of a round pad, pressed in by a fifth of it."""
    pad = DiscPad(radius_m=4e-3, height_m=small_pads.HEIGHT_M)
    mesh = small_pads.round_mesh(pad=pad, start_m=0.0, size_m=1e-3, symmetric=False)
    path = LoadingPath(small_pads.pad_model(mesh, bonded=True), Plane())
    point = path.advance(0.2 * small_pads.HEIGHT_M)
    ratio_min = point.equilibrium.min_jacobian
    torques = [0.0]
    for _ in range(round(turn_deg / step_deg)):
        point = path.carry(twist_rad=float(np.radians(step_deg)))
        torques.append(-float(contact_measures(path.model, point).moment_nm[2]))
        ratio_min = min(ratio_min, point.equilibrium.min_jacobian)
    return {
        "torque_kink_share": float(np.abs(np.diff(torques, n=2)).max() / max(torques)),
        "torque_first_step_nm": torques[1],
        "torque_end_nm": torques[-1],
        "force_end_n": float(point.force_n[2]),
        "min_jacobian": ratio_min,
        "newton_iterations": path.counts.newton_iterations,
        "increments": path.counts.increments,
    }


_RAMP_TO_M = 0.4e-3
_RAMP_FROM_M = 0.36e-3
_RAMP_STEPS_S = (1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0)
# The pad's slowest tone is of about 2 ms.
_RAMP_S = 6e-3
_LISTEN_S = 2e-3
_IMPACT_FROM_M = -0.01e-3
_IMPACT_TO_M = 0.4e-3
# Depths as near as this are one.
_HELD_M = 1e-12
_SPEEDS_M_S = (1.0, 2.0, 5.0)
_TRAVEL_A_STEP_M = 0.02e-3
_IMPACT_STEP_COUNT = 30


def time_steps() -> Measured:
    """Press to a depth with every time step, and without time at once."""
    model = small_pads.pad_model(small_pads.round_mesh(), order=ElementOrder.P1)
    static = LoadingPath(model, small_pads.PUNCH).advance(_RAMP_TO_M).force_n[2]
    path = LoadingPath(model, small_pads.PUNCH, step_max_m=1.0)
    at_once = path.advance(_RAMP_TO_M).force_n[2] / static - 1.0
    measured: Measured = {
        "force_static_n": float(static),
        "at_once_deviation": at_once,
        "at_once_increments": path.counts.increments,
    }
    worst = abs(at_once)
    for step_s in _RAMP_STEPS_S:
        jumped = _jump(model, step_s) / static - 1.0
        even = max((force / static - 1.0 for force in _ramp(model, step_s)), key=abs)
        measured[f"dt_{step_s:g}s_one_step_deviation"] = jumped
        measured[f"dt_{step_s:g}s_even_steps_deviation"] = even
        worst = max(worst, abs(jumped), abs(even))
    return measured | {"deviation_max": worst}


def _jump(model: Model, step_s: float) -> float:
    """Return F_z [N] after the whole depth at once, then rest in steps that grow."""
    inertia = Inertia(model, small_pads.DENSITY_KG_M3)
    path = LoadingPath(model, small_pads.PUNCH, step_max_m=1.0, inertia=inertia)
    found, held_s = path.advance(_RAMP_TO_M, duration_s=step_s), step_s
    while held_s < 1.0:
        held_s *= 4.0
        found = path.dwell(held_s)
    return float(found.force_n[2])


def _ramp(model: Model, step_s: float) -> list[float]:
    """Return F_z [N] for as long as the slowest tone, after a smooth ramp in even steps."""
    path = LoadingPath(model, small_pads.PUNCH, inertia=Inertia(model, small_pads.DENSITY_KG_M3))
    path.advance(_RAMP_FROM_M)
    forces, time_s = [], 0.0
    while time_s < _RAMP_S + _LISTEN_S:
        time_s += step_s
        share = min(1.0, time_s / _RAMP_S)
        smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        found = time_step(path, _RAMP_FROM_M + (_RAMP_TO_M - _RAMP_FROM_M) * smooth, step_s)
        if share == 1.0:
            forces.append(float(found.force_n[2]))
    return forces


def time_step(path: LoadingPath, depth_m: float, step_s: float) -> PathPoint:
    """Bring the indenter to a depth, or hold it there, for a time."""
    held = path.last is not None and abs(depth_m - path.last.depth_m) <= _HELD_M
    return path.dwell(step_s) if held else path.advance(depth_m, duration_s=step_s)


def energy_j(path: LoadingPath, inertia: Inertia) -> float:
    """Return the whole pad's energy [J] where the path is: of gel, contact, weight and motion."""
    state = path.last.state if path.last is not None else path.untouched(0.0)
    squares = np.sum(inertia.velocities_m_s**2, axis=1)
    energy = small_pads.stored_j(path.model, path.indenter, state)
    energy += 0.0 if path.potential is None else path.potential.energy(state.positions)
    return path.model.mesh.symmetry.copies * (energy + 0.5 * float(inertia.masses_kg @ squares))


def impact() -> Measured:
    """Follow energies and gaps through every impact."""
    model = small_pads.pad_model(small_pads.round_mesh(), order=ElementOrder.P1)
    rise, gap, peak, touching = -np.inf, np.inf, 0.0, 0
    bodies: tuple[Indenter, ...] = (small_pads.PUNCH, small_pads.BALL)
    for indenter, speed_m_s, thrown in product(bodies, _SPEEDS_M_S, (False, True)):
        steps, gained = _impact(model, indenter, speed_m_s, thrown=thrown)
        rise = max(rise, float(gained.max()))
        gaps = (model.surface.gaps(s.state.positions, indenter, s.state) for s in steps)
        gap = min(gap, *(float(each.min()) for each in gaps))
        force = max(float(step.force_n[2]) for step in steps)
        peak, touching = max(peak, force), touching + (force > 0.0)
    return {
        "impacts": 2 * 2 * len(_SPEEDS_M_S),
        "impacts_that_touched": touching,
        "energy_gain_max_over_impact": rise,
        "gap_min_m": gap,
        "force_max_n": peak,
    }


def _impact(
    model: Model, indenter: Indenter, speed_m_s: float, *, thrown: bool
) -> tuple[list[PathPoint], FloatArray]:
    """Drive an indenter in and hold it, or throw the gel at one that stands still.

    Returns:
        The steps, and the energy that each gained over its own or the indenter's work.
    """
    inertia = Inertia(model, small_pads.DENSITY_KG_M3)
    path = LoadingPath(model, indenter, inertia=inertia)
    path.advance(_IMPACT_FROM_M)
    if thrown:
        inertia.velocities_m_s[:, 2] = speed_m_s * model.nodes[:, 2] / small_pads.HEIGHT_M
    depth, energies, works = _IMPACT_FROM_M, [energy_j(path, inertia)], [0.0]
    steps: list[PathPoint] = []
    for k in range(_IMPACT_STEP_COUNT):
        goal = min(_IMPACT_FROM_M + (k + 1) * _TRAVEL_A_STEP_M, _IMPACT_TO_M)
        time_s = _TRAVEL_A_STEP_M / speed_m_s
        steps.append(time_step(path, depth if thrown else goal, time_s))
        travel, depth = steps[-1].depth_m - depth, steps[-1].depth_m
        works.append(works[-1] + float(steps[-1].force_n[2]) * travel)
        energies.append(energy_j(path, inertia))
    size = energies[0] if thrown else max(works)
    return steps, np.diff(np.array(energies) - works) / size
