"""What a press passes on its way to a force: a few of the equilibria at which it stood anyhow."""

from __future__ import annotations

from sim.fields.contact_traction import surface_traction
from sim.fields.press_fields import surface_state, top_surface
from sim.fields.surface import PassedState
from sim.solve.loading_path import LoadingPath
from sim.solve.path_point import PathPoint

KEPT = 12
"""States of a path, at most."""
# Under a ball the depth goes with the force to the power of 2/3: forces as far apart are about
# evenly deep.
_BY_DEPTH = 1.5
# By so much a state has to be less loaded than the one it leads to.
_LESS = 0.97


def passed_state(path: LoadingPath, point: PathPoint, *, stiffer: float = 1.0) -> PassedState:
    """Return an equilibrium as the camera and the contact need it.

    Args:
        stiffer: How many times as stiff as the path's the gel is that it is told of: at as many
            times the force it stands there too.
    """
    pressure = surface_traction(path.model, point).pressure_pa
    return PassedState(
        force_n=stiffer * float(point.force_n[2]),
        depth_m=point.depth_m,
        surface=surface_state(path, point),
        pressure_pa=stiffer * pressure[top_surface(path.model).sources],
    )


class PassedStates:
    """Chooses what is told of a path that keeps its points; no press is made for it.

    Points in passing balance to 0.01 % of the contact's force.

    Args:
        path: Of a gel that may be less stiff.
        force_n: The largest that is pressed to [N].
        stiffer: As for ``passed_state``.
    """

    def __init__(self, path: LoadingPath, force_n: float, *, stiffer: float = 1.0) -> None:
        self._path, self._stiffer = path, stiffer
        self._wanted_n = [(k / KEPT) ** _BY_DEPTH * force_n for k in range(1, KEPT)]
        self._told: dict[int, PassedState] = {}

    def before(self, force_n: float) -> list[PassedState]:
        """Return those that carried clearly less than a force [N], the smallest force first."""
        forces = [self._stiffer * float(point.force_n[2]) for point in self._path.points]
        below = [k for k, each in enumerate(forces) if 0.0 < each < _LESS * force_n]
        wanted = [each for each in self._wanted_n if each < force_n]
        nearest = {min(below, key=lambda k: abs(forces[k] - each)) for each in wanted if below}
        return [self._state(k) for k in sorted(nearest, key=lambda k: forces[k])]

    def _state(self, k: int) -> PassedState:
        if k not in self._told:
            point = self._path.points[k]
            self._told[k] = passed_state(self._path, point, stiffer=self._stiffer)
        return self._told[k]
