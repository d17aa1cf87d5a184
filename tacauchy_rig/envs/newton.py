"""A tactile sensor for newton, in the style of newton's own sensors.

``python -m tacauchy_rig.envs.newton`` drops balls on pads and prints wrench over weight.
"""

import time
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Annotated, Any

import numpy as np
import typer

from sim.coupling import rigid_body_kernels as kernels
from sim.coupling.rigid_body_contact import UNMOVED, GelContact
from sim.device import Device, start_warp
from sim.scene.indenter import Indenter, Sphere
from sim.sensor.sensor import load_sensor
from tacauchy_rig.core.arrays import IntArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.versions import library

newton = library("newton", extra="newton")


class TactileSensor:
    """Gels on bodies of a newton model, each pressed by one object.

    ``update`` presses the objects where a state has them; ``apply`` adds the forces to
    ``state.body_f``, before the solver's step. Switch newton's own contact between the bodies off
    (``ModelBuilder.add_shape_collision_filter_pair``).

    Args:
        model: Finalised; on the CPU or a GPU.
        pads: Label pattern, or numbers, of the bodies that carry gels.
        objects: Likewise, of the bodies that press, one for each gel.
        indenter: Their shape.
        pad_frame: Middle of the gel's base in its body [m], and quaternion; z points out of it.
        tip_frame: Lowest point of the shape in its body [m], and quaternion.
        settings: As ``GelContact`` takes them.

    Attributes:
        contact: The gels: ``wrench``, ``force_error``, ``is_valid``, ``images()``.

    Raises:
        ConfigError: There are not as many objects as pads, or none.
    """

    def __init__(
        self,
        model: Any,
        pads: str | Sequence[int],
        objects: str | Sequence[int],
        indenter: Indenter,
        *,
        pad_frame: Sequence[float] = UNMOVED,
        tip_frame: Sequence[float] = UNMOVED,
        **settings: Any,
    ) -> None:
        carrying, pressing = (_bodies(model, each) for each in (pads, objects))
        if len(carrying) != len(pressing) or not len(carrying):
            raise ConfigError(
                f"{len(carrying)} pads and {len(pressing)} objects",
                remedy="name one object for each pad, by the labels of their bodies",
            )
        self._device, self._count = Device(str(model.device)), (len(carrying),)
        self.contact = GelContact(
            indenter, count=len(carrying), device=self._device.name, **settings
        )
        self._model = model
        self._numbers = [self._device.array(each, int) for each in (carrying, pressing)]
        self._frames = [self._device.array([each], kernels.Pose) for each in (pad_frame, tip_frame)]

    def update(self, state: Any) -> None:
        """Press the objects into the gels where a state has them."""
        model, contact = self._model, self.contact
        inertia = [model.body_com, model.body_inv_mass, model.body_inv_inertia]
        sides = zip(self._numbers, self._frames, (contact.pads, contact.objects), strict=True)
        for numbers, frame, bodies in sides:
            given = [numbers, frame, *inertia, state.body_q, state.body_qd]
            self._device.launch(kernels.gather, self._count, given, [bodies])
        contact.press()

    def apply(self, state: Any, step_s: float) -> None:
        """Add the forces of the last ``update`` to the bodies, for a solver's step [s]."""
        self.contact.react(step_s)
        loads = (self.contact.on_pads, self.contact.on_objects)
        for numbers, load in zip(self._numbers, loads, strict=True):
            self._device.launch(kernels.scatter, self._count, [numbers, load], [state.body_f])


def _bodies(model: Any, chosen: str | Sequence[int]) -> IntArray:
    if isinstance(chosen, str):
        chosen = [k for k, label in enumerate(model.body_label) if fnmatchcase(label, chosen)]
    return np.array(chosen, dtype=np.int32)


def balls_on_pads(
    count: int,
    *,
    device: str,
    diameter_m: float = 8e-3,
    mass_kg: float = 0.02,
    fall_m: float = 1e-4,
    **settings: Any,
) -> tuple[Any, TactileSensor]:
    """Return a model of balls above gels that are held fast, and its sensor.

    The balls are weighted at the bottom, so that they right themselves: others roll off a dome.
    """
    builder, height_m = newton.ModelBuilder(), load_sensor("gelsight-mini").pad.height_m
    inertia = 0.4 * mass_kg * (diameter_m / 2.0) ** 2
    for k in range(count):
        builder.begin_world()
        builder.add_body(xform=(UNMOVED[:3], UNMOVED[3:]), label="pad", is_kinematic=True)
        builder.add_body(
            xform=((1e-4 * (k % 10), 0.0, height_m + fall_m), UNMOVED[3:]),
            com=(0.0, 0.0, diameter_m / 4.0),
            mass=mass_kg,
            inertia=[inertia, 0.0, 0.0, 0.0, inertia, 0.0, 0.0, 0.0, inertia],
            lock_inertia=True,
            label="ball",
        )
        builder.end_world()
    model = builder.finalize(device=device)
    return model, TactileSensor(model, "*pad", "*ball", Sphere(diameter_m=diameter_m), **settings)


def main(
    environments: Annotated[int, typer.Option(help="Balls, each on a gel of its own.")] = 4,
    steps: Annotated[int, typer.Option(help="Of the engine.")] = 400,
    step_s: Annotated[float, typer.Option(help="Length of a step [s].")] = 1e-3,
    device: Annotated[str, typer.Option(help="cpu or cuda:0.")] = "cpu",
    friction: Annotated[float, typer.Option(help="Between ball and gel.")] = 0.5,
    images: Annotated[bool, typer.Option(help="Draw every camera in every step.")] = False,
) -> None:
    """Drop balls on gels, and print wrench over weight, and steps per second."""
    start_warp()
    typer.echo("compiling kernels: a minute the first time")
    model, sensor = balls_on_pads(environments, device=device, friction=friction)
    solver, weight_n = newton.solvers.SolverSemiImplicit(model), 0.02 * 9.81
    state, after = model.state(), model.state()
    felt_s, said = 0.0, time.perf_counter()
    started = said
    for k in range(steps):
        state.clear_forces()
        at = time.perf_counter()
        sensor.update(state)
        sensor.apply(state, step_s)
        if images:
            sensor.contact.images()
        Device(device).synchronise()
        felt_s += time.perf_counter() - at
        solver.step(state, after, None, None, step_s)
        state, after = after, state
        if k == 0:  # kernels are compiled
            felt_s, started = 0.0, time.perf_counter()
        if time.perf_counter() - said > 2.0:
            said = time.perf_counter()
            ratio = sensor.contact.wrench.numpy()[:, 2].mean() / weight_n
            typer.echo(f"step {k + 1} of {steps}: wrench over weight {ratio:.4f}")
    took, many = time.perf_counter() - started, environments * max(steps - 1, 1)
    ratios = sensor.contact.wrench.numpy()[:, 2] / weight_n
    typer.echo(f"wrench over weight: {ratios.min():.4f} to {ratios.max():.4f}")
    typer.echo(
        f"steps/s over {environments} environments: {many / took:.0f} of the whole loop, "
        f"{many / felt_s:.0f} of the sensor alone ({felt_s / took:.0%} of the time)"
    )


if __name__ == "__main__":
    typer.run(main)
