"""Where a ball's contact lies in an image, for presses that nobody has labelled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage
from scipy.optimize import minimize

from sim.optics.calibrate.presses.ball_press import Circle
from sim.optics.calibrate.presses.scene import PressScene
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError

_SMOOTHING_PX = 2.0
_RADII = (0.25, 0.45, 0.65)  # of contacts to start from, in radii of the ball
_STRIDE = 4
_FAINTEST_LEVELS = 4.0
_STRONG_QUANTILE = 0.97  # of the changes, where a search for the contact starts
_LEAST_EXPLAINED = 0.3  # of the changes' variance


def find_circle(name: str, image: ImageArray, scene: PressScene, *, ball_radius_m: float) -> Circle:
    """Find the contact by how strongly the colour changes, whatever the lights' colours are.

    Coloured lights from several sides change the colour about in proportion to the surface's tilt;
    the tilt that the gel would have around each candidate circle is fitted to the change.

    Args:
        image: RGB, shape [height, width, 3].
        ball_radius_m: Radius of the ball [m].

    Raises:
        ConfigError: The image shows no contact.
    """
    change = image - scene.background
    change = change - np.median(change, axis=(0, 1))  # that of the frame's light
    smooth = ndimage.gaussian_filter(change, (_SMOOTHING_PX, _SMOOTHING_PX, 0.0))
    seen = np.linalg.norm(smooth[::_STRIDE, ::_STRIDE], axis=2).ravel()
    height, width = image.shape[:2]
    y, x = np.mgrid[:height:_STRIDE, :width:_STRIDE].astype(np.float64).reshape(2, -1)
    strong = seen >= np.quantile(seen, _STRONG_QUANTILE)
    start = float(np.median(x[strong])), float(np.median(y[strong]))
    level_gel = replace(scene, rest_slope=None)  # a dome's own slope changes no image

    def misfit(parameters: FloatArray) -> float:
        px, py, radius = parameters
        circle = Circle(x_px=px, y_px=py, radius_px=max(float(radius), 1.0))
        tilt = np.hypot(*level_gel.surface(circle, x, y).tilt)
        tilt = tilt - tilt.mean()
        level = seen - seen.mean()
        gain = max(float(tilt @ level) / max(float(tilt @ tilt), 1e-12), 0.0)
        return float(np.mean((level - gain * tilt) ** 2))

    scale = scene.geometry.mean_scale_m
    starts = [[*start, share * ball_radius_m / scale] for share in _RADII]
    searches = (minimize(misfit, begin, method="Nelder-Mead") for begin in starts)
    found = min(searches, key=lambda search: float(search.fun))
    px, py, radius = found.x.tolist()
    explained = 1.0 - float(found.fun) / max(float(np.var(seen)), 1e-12)
    inside = 0.0 <= px < width and 0.0 <= py < height and 1.0 < radius < ball_radius_m / scale
    if not inside or seen.max() < _FAINTEST_LEVELS or explained < _LEAST_EXPLAINED:
        raise ConfigError(
            f"{name} shows no contact of a ball that can be found",
            remedy="remove the image, or give its circle in a table: --circles circles.csv",
        )
    return Circle(x_px=px, y_px=py, radius_px=radius)
