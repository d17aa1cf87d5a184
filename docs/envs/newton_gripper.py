"""Two fingers with gels close on a peg, take its weight, and open until it slips.

    python docs/envs/newton_gripper.py

Prints the grip at which the peg slips, and the grip that Coulomb's law asks for.
"""

from __future__ import annotations

import newton
import numpy as np

from tacauchy_rig import Cylinder, load_sensor
from tacauchy_rig.envs.newton import TactileSensor

MASS_KG, RADIUS_M, FRICTION, STEP_S = 0.1, 4e-3, 0.5, 1e-3
CLOSED_M, SPEED_M_S, SLIP_M_S = 0.25e-3, 1e-3, 0.01
TURNED = np.sqrt(0.5)


def main() -> None:
    """Grip, open, and print at which force the peg slips."""
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    for side in (-1.0, 1.0):  # a gel's z points at the peg
        turn = (0.0, -side * TURNED, 0.0, TURNED)
        builder.add_body(xform=((0.0, 0.0, 0.0), turn), label="finger", is_kinematic=True)
    builder.add_body(
        xform=((0.0, 0.0, -0.02), (0.0, 0.0, 0.0, 1.0)),
        com=(0.0, 0.0, 0.02),
        mass=MASS_KG,
        inertia=np.diag([1e-5, 1e-5, 1e-6]).ravel().tolist(),
        lock_inertia=True,
        label="peg",
    )
    model = builder.finalize(device="cpu")
    peg = Cylinder(diameter_m=2.0 * RADIUS_M, fillet_m=1e-3)
    sensor = TactileSensor(model, [0, 1], [2, 2], peg, friction=FRICTION)
    solver = newton.solvers.SolverSemiImplicit(model)
    state, after = model.state(), model.state()
    surface_m, squeeze_m, closing = load_sensor("gelsight-mini").pad.height_m + RADIUS_M, 0.0, 1.0
    while True:
        squeeze_m += closing * SPEED_M_S * STEP_S
        poses, forces = state.body_q.numpy(), np.zeros((3, 6), np.float32)
        poses[:2, 0] = np.array([-1.0, 1.0]) * (surface_m - squeeze_m)
        state.body_q.assign(poses)
        if squeeze_m >= CLOSED_M:
            closing = -1.0
        carried = 1.0 if closing < 0.0 else max(0.0, 2.0 * squeeze_m / CLOSED_M - 1.0)
        forces[2, 2] = -MASS_KG * 9.81 * carried
        state.body_f.assign(forces)
        sensor.update(state)
        sensor.apply(state, STEP_S)
        solver.step(state, after, None, None, STEP_S)
        state, after = after, state
        if state.body_qd.numpy()[2, 2] < -SLIP_M_S and closing < 0.0:
            break
    grip_n = sensor.contact.wrench.numpy()[:, 2]
    print(f"slips at {squeeze_m * 1e3:.2f} mm with a grip of {grip_n[0]:.2f} and {grip_n[1]:.2f} N")
    print(f"Coulomb: {MASS_KG * 9.81 / (2.0 * FRICTION):.2f} N on each side")


if __name__ == "__main__":
    main()
