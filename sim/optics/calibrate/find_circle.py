"""Where a ball's contact lies in an image, for presses that nobody has labelled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage
from scipy.optimize import minimize

from sim.optics.calibrate.ball_press import BallPress, Circle
from sim.optics.calibrate.press_scene import PressScene
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

_SMOOTHING_PX = 2.0
_RADII = (0.25, 0.45, 0.65)  # of contacts to start from, in radii of the ball
_STRIDE = 4
_FAINTEST_LEVELS = 4.0
_STRONG_QUANTILE = 0.97  # of the changes, where a search for the contact starts
_LEAST_EXPLAINED = 0.3  # of the changes' variance


def wrong_label(press: BallPress, scene: PressScene, *, ball_radius_m: float) -> str | None:
    """Return what contradicts a press's label; None where its image shows the contact there.

    A contact that contradicts it is farther away than the label's radius.
    """
    change, label = _ContactChange(press, scene), press.circle
    if label.distance(*change.start) < label.radius_px:
        return None
    found, explained = change.search(ball_radius_m)
    as_labelled = change.explained(label)
    is_near = label.distance(np.float64(found.x_px), np.float64(found.y_px)) < label.radius_px
    if is_near or explained < _LEAST_EXPLAINED or explained < 2.0 * as_labelled:
        return None
    return (
        f"{press.name} was left out: its label says column {label.x_px:.0f}, row "
        f"{label.y_px:.0f}, radius {label.radius_px:.0f} px, but the image shows the contact "
        f"at {found.x_px:.0f}, {found.y_px:.0f}, radius {found.radius_px:.0f} px, which "
        f"explains {explained:.0%} of the change of colour, the label "
        f"{max(as_labelled, 0.0):.0%}; correct the label"
    )


def find_circle(press: BallPress, scene: PressScene, *, ball_radius_m: float) -> Circle:
    """Find the contact by how strongly the colour changes, whatever the lights' colours are.

    Coloured lights from several sides change the colour about in proportion to the surface's tilt;
    the tilt that the gel would have around each candidate circle is fitted to the change.

    Raises:
        ConfigError: The image shows no contact.
    """
    change = _ContactChange(press, scene)
    found, explained = change.search(ball_radius_m)
    height, width = press.image.shape[:2]
    largest = ball_radius_m / scene.geometry.mean_scale_m
    inside = 0.0 <= found.x_px < width and 0.0 <= found.y_px < height
    inside &= 1.0 < found.radius_px < largest
    if not inside or change.strongest < _FAINTEST_LEVELS or explained < _LEAST_EXPLAINED:
        raise ConfigError(
            f"{press.name} shows no contact of a ball that can be found",
            remedy="remove the image, or give its circle in a table: --circles circles.csv",
        )
    return found


class _ContactChange:
    """How strongly the colour of an image changes, and which contact explains that.

    Attributes:
        start: Column and row of the middle of the strongest changes [px].
        strongest: Of the changes [grey levels].
    """

    def __init__(self, press: BallPress, scene: PressScene) -> None:
        known = press.shown
        change = press.image - scene.background
        change = change - np.median(change[known], axis=0)  # that of the frame's light
        weight = ndimage.gaussian_filter(known.astype(np.float64), _SMOOTHING_PX)
        smooth = ndimage.gaussian_filter(
            np.where(known[..., None], change, 0.0), (_SMOOTHING_PX, _SMOOTHING_PX, 0.0)
        )
        smooth = smooth / np.maximum(weight, 1e-3)[..., None]
        rows, columns = np.nonzero(known[::_STRIDE, ::_STRIDE])
        self._y, self._x = rows * float(_STRIDE), columns * float(_STRIDE)
        seen = np.linalg.norm(smooth[::_STRIDE, ::_STRIDE], axis=2)[rows, columns]
        strong = seen >= np.quantile(seen, _STRONG_QUANTILE)
        self._seen, self.strongest = seen - seen.mean(), float(seen.max())
        self.start = np.median(self._x[strong]), np.median(self._y[strong])
        self._gel = replace(scene, rest_slope=None)  # a dome's own slope changes no image

    def explained(self, circle: Circle) -> float:
        """Return which share of the changes' variance the gel's tilt around a contact explains."""
        tilt = np.hypot(*self._gel.surface(circle, self._x, self._y)[:2])
        tilt = tilt - tilt.mean()
        gain = max(float(tilt @ self._seen) / max(float(tilt @ tilt), 1e-12), 0.0)
        left = float(np.mean((self._seen - gain * tilt) ** 2))
        return 1.0 - left / max(float(np.var(self._seen)), 1e-12)

    def search(self, ball_radius_m: float) -> tuple[Circle, float]:
        """Return the contact that explains most, and how much it does."""

        def circle(parameters: FloatArray) -> Circle:
            x, y, radius = parameters.tolist()
            return Circle(x_px=x, y_px=y, radius_px=max(radius, 1.0))

        scale = self._gel.geometry.mean_scale_m
        searches = [
            minimize(
                lambda place: -self.explained(circle(place)),
                [*self.start, share * ball_radius_m / scale],
                method="Nelder-Mead",
            )
            for share in _RADII
        ]
        found = min(searches, key=lambda search: float(search.fun))
        return circle(found.x), -float(found.fun)
