"""A force servo in velocity: the arm is an integrator, the gel a spring of unknown stiffness.

speed = (K e + I) / k with e the force error [N], K the bandwidth [1/s], I the integral that
follows the gel's relaxation [N/s] and k the secant stiffness seen so far [N/m]. With about 0.1 s
of delay in the loop K = 2.5/s leaves a factor of four before it oscillates.
"""

from __future__ import annotations

BANDWIDTH_PER_S = 2.5
INTEGRAL_PER_S2 = 0.8
INTEGRAL_BAND_N = 0.05
INTEGRAL_LIMIT_N_S = 0.4
FILTER_TIME_S = 0.03
STIFFNESS_MIN_N_M = 300.0
STIFFNESS_MAX_N_M = 20e3
STIFFNESS_DEPTH_M = 30e-6


class ForceServo:
    """Turns force samples into a speed towards the gel.

    Args:
        target_n: Force to hold [N].
        speed_cap: Largest speed either way [m/s].
        period_s: Between samples [s].
        contact_force_n: Force at depth zero [N].

    Attributes:
        filtered_n: Low-passed force [N]; only for the servo.
    """

    def __init__(
        self, *, target_n: float, speed_cap: float, period_s: float, contact_force_n: float
    ) -> None:
        self.target_n = target_n
        self.filtered_n = contact_force_n
        self._speed_cap = speed_cap
        self._period_s = period_s
        self._contact_force_n = contact_force_n
        self._smoothing = period_s / (FILTER_TIME_S + period_s)
        self._integral_n_s = 0.0
        self._stiffness_n_m = STIFFNESS_MAX_N_M

    def update(self, force_n: float, *, depth_m: float) -> float:
        """Take one sample at ``depth_m`` below contact; return the speed towards the gel [m/s]."""
        self.filtered_n += self._smoothing * (force_n - self.filtered_n)
        self._learn_stiffness(depth_m)
        error_n = self.target_n - self.filtered_n
        if abs(error_n) < INTEGRAL_BAND_N:
            step = INTEGRAL_PER_S2 * error_n * self._period_s
            total = self._integral_n_s + step
            self._integral_n_s = min(INTEGRAL_LIMIT_N_S, max(-INTEGRAL_LIMIT_N_S, total))
        speed = (BANDWIDTH_PER_S * error_n + self._integral_n_s) / self._stiffness_n_m
        return min(self._speed_cap, max(-self._speed_cap, speed))

    def _learn_stiffness(self, depth_m: float) -> None:
        if depth_m < STIFFNESS_DEPTH_M:
            return
        secant = (self.filtered_n - self._contact_force_n) / depth_m
        self._stiffness_n_m = min(STIFFNESS_MAX_N_M, max(STIFFNESS_MIN_N_M, secant))
