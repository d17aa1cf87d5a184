"""Stress relaxation of the gel.

Viscoelasticity is a Prony series on the second Piola-Kirchhoff stress. With S(F) the law's stress
at its slow modulus E and r_i = g_i / (1 - sum g) the branches' stiffness in units of E,

    S_total = S + sum r_i h_i,  dh_i/dt = dS/dt - h_i / tau_i

Over a step dt the stress is taken to change evenly (Taylor, Pister, Goudreau 1970; Simo 1987):

    h_i <- exp(-dt/tau_i) h_i + gamma_i (S_new - S_old),  gamma_i = (1 - exp(-dt/tau_i)) tau_i/dt

which makes S_total = c S_new + H with c = 1 + sum r_i gamma_i and H known before the step. A step
is then an equilibrium under the energy c psi(F) + 1/2 H : (F^T F - 1). For dt far above tau c is
one, the slow modulus; for dt far below, 1/(1 - sum g), the instantaneous one. Shear and volume
relax alike: Poisson's ratio stays.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from sim.device import Device, on_host
from sim.material.elasticity_kernels import stress_kernel
from sim.material.laws.law_and_lame import Law
from sim.scene.material import RelaxationTerm
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError


class PronySeries(NamedTuple):
    """Stiffness E (1 + sum of ratios) at once, E after a long time."""

    times_s: FloatArray  # time constants [s], shape [term_count]
    ratios: FloatArray  # stiffness that goes, over E, shape [term_count, element_count]


def prony_series(
    terms: Sequence[Sequence[RelaxationTerm]], material_of: IntArray
) -> PronySeries | None:
    """Collect the terms of materials for tetrahedra [element_count]; None where none relaxes.

    Raises:
        ConfigError: A material loses all of its stiffness.
    """
    times = sorted({term.time_s for material in terms for term in material})
    if not times:
        return None
    shares = np.zeros((len(times), len(terms)))
    for material, its_terms in enumerate(terms):
        for term in its_terms:
            shares[times.index(term.time_s), material] += term.share
    lost = shares.sum(axis=0)
    if lost.max() >= 1.0:
        raise ConfigError(
            f"relaxation takes {lost.max():.4g} of the instantaneous stiffness",
            remedy="let the shares of all terms sum to less than 1",
        )
    return PronySeries(np.array(times), (shares / (1.0 - lost))[:, material_of])


class Relaxation:
    """What the points of a model remember, on the host; the model's arrays have what a step needs.

    Until ``begin_step`` the gel answers with its slow modulus and remembers nothing. The history H
    is one tensor a quadrature point, constant over a step; of a law that is not objective, which is
    linear in F - 1, it is too: its energy is H : (F - 1).

    Args:
        gel: The model's ``GelArrays``, of which ``stiffening`` and ``history`` are kept.
        positions: The nodes when nothing was remembered [m], shape [node_count, 3].
    """

    def __init__(
        self, law: Law, gel: Any, series: PronySeries, positions: FloatArray, device: Device
    ) -> None:
        self.series, self._gel, self._device = series, gel, device
        self._slow_stress = stress_kernel(law, slow=True)
        self._ratios = series.ratios[..., None, None, None]
        self._stress = np.zeros((*gel.weights.shape, 3, 3))
        self._branches = np.zeros((len(series.times_s), *self._stress.shape))
        self.forget(positions)

    def forget(self, positions: FloatArray) -> None:
        """Take the gel to have been held at ``positions`` [m] for ever."""
        self._set_step(np.zeros(len(self.series.times_s)), np.zeros(len(self.series.times_s)))
        self._gel.history.zero_()
        self.commit(positions)

    def begin_step(self, step_s: float) -> None:
        """Prepare a step [s], from 0 to inf, from the last commit; it may be begun again."""
        spent = step_s / self.series.times_s
        gains = np.divide(-np.expm1(-spent), spent, out=np.ones_like(spent), where=spent > 0.0)
        self._set_step(np.exp(-spent), gains)
        kept = self._keeps * self._branches - self._gains * self._stress
        self._gel.history.assign((self._ratios * kept).sum(axis=0))

    def commit(self, positions: FloatArray) -> None:
        """Accept ``positions`` [m] as the end of the step that was begun."""
        out = self._device.empty((1, *self._gel.weights.shape), wp.mat33d)
        inputs = [self._gel, self._device.array(positions[None], wp.vec3d)]
        self._device.launch(self._slow_stress, out.shape, inputs, [out])
        stress = on_host(out)[0]
        self._branches = self._keeps * self._branches + self._gains * (stress - self._stress)
        self._stress = stress

    def _set_step(self, keeps: FloatArray, gains: FloatArray) -> None:
        self._keeps, self._gains = (each[:, None, None, None, None] for each in (keeps, gains))
        self._gel.stiffening.assign(1.0 + gains @ self.series.ratios)
