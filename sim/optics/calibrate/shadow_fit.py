"""Lamps that cast shadows, fitted to ball presses together with the colours.

Colours and shadows are told apart by turns: what the smooth model of slopes leaves over is searched
for shadows of the lamps that the sensor's file names, and the model is fitted again to the presses
without those.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import cv2
import numpy as np
from pydantic import TypeAdapter

from sim.optics.calibrate.colours import Calibration, calibrate_optics
from sim.optics.calibrate.press_image import lit_presses, pressed_surface
from sim.optics.calibrate.presses.ball_press import BallPress
from sim.optics.calibrate.presses.scene import PlacedPress, PressScene
from sim.optics.render.shadows import lost_share
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.optics import Lamp, ShadowCaster
from tacauchy_rig.core.arrays import Float32Array, FloatArray

SHADOWS = "shadows"  # their name in a calibration's provenance
_ROUNDS = 2
_LOOKED_AT = 10  # deepest presses; their shadows are the longest
_COARSE = 2  # pixels along rows and columns that are taken together
_STEPS = (0.2, 0.1, 0.05)  # of azimuth [rad], and of the logarithm of elevation
_LOWEST_RAD, _HIGHEST_RAD = math.radians(3.0), math.radians(45.0)


_Dent = tuple[Float32Array, Float32Array, Float32Array]
"""A press at coarse pixels: bulge [m], tilt, and what the colours leave over, shape [n, 3]."""


def calibrate_with_shadows(
    presses: Sequence[BallPress], scene: PressScene, nominal: ShadowCaster
) -> Calibration:
    """Fit colours, and direction, elevation and colour of the lamps' shadows.

    The search starts at the lamps of the sensor's file. Their softness stays: the short shadows of
    a ball do not tell a soft strong one from a sharp weak one.

    Raises:
        ConfigError: As ``calibrate_optics``.
    """
    found, shadows = calibrate_optics(presses, scene), nominal
    for _ in range(_ROUNDS):
        shadows = _fitted(presses, found, shadows)
        lit = lit_presses(presses, replace(found, shadows=shadows))
        found = calibrate_optics([each.press for each in lit], scene)
    return replace(found, shadows=shadows)


def _fitted(presses: Sequence[BallPress], found: Calibration, start: ShadowCaster) -> ShadowCaster:
    """Search direction and elevation one lamp after the other; colours follow linearly."""
    chosen = np.argsort([-circle.radius_px for circle in found.circles])[:_LOOKED_AT]
    placed = found.placed(presses)
    dents = [_dent(placed[i], found) for i in chosen.tolist()]
    geometry = found.scene.geometry.refined(1.0 / _COARSE)
    best, misfit = _coloured(start, dents, geometry)
    for step in _STEPS:
        moves = product(range(len(start.lamps)), (_turned, _raised), (-step, step))
        for index, move, by in moves:
            while True:
                lamps = list(best.lamps)
                lamps[index] = move(lamps[index], by)
                trial, error = _coloured(replace(best, lamps=lamps), dents, geometry)
                if error >= misfit:
                    break
                best, misfit = trial, error
    return best


def _dent(placed: PlacedPress, found: Calibration) -> _Dent:
    scene, circle, image = found.scene, placed.circle, placed.press.image
    bulge, tilt = pressed_surface(scene, circle)
    left = (
        image
        - scene.background
        - scene.light_image(placed.light)
        - scene.whole_image(found.model).predict(circle).reshape(image.shape)
    )
    size = (bulge.shape[1] // _COARSE, bulge.shape[0] // _COARSE)

    def coarse(values: FloatArray | Float32Array) -> Float32Array:
        small = cv2.resize(values.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        return np.asarray(small, dtype=np.float32)

    return coarse(bulge), np.stack([coarse(t) for t in tilt]), coarse(left).reshape(-1, 3)


def _coloured(
    shadows: ShadowCaster, dents: Sequence[_Dent], geometry: CameraGeometry
) -> tuple[ShadowCaster, float]:
    """Give the lamps the colours that explain best what is left over; return the misfit too."""
    count = len(shadows.lamps)
    normal, load, total = np.zeros((count, count)), np.zeros((count, 3)), 0.0
    for bulge, tilt, left_over in dents:
        lost = [
            lost_share(bulge, tilt, lamp, geometry, softness_m=shadows.softness_m)
            for lamp in shadows.lamps
        ]
        terms = np.stack(lost).reshape(count, -1).astype(np.float64)
        normal += terms @ terms.T
        load -= terms @ left_over
        total += float(np.sum(left_over**2))
    colours = np.maximum(np.linalg.lstsq(normal, load, rcond=None)[0], 0.0)
    misfit = total - 2.0 * float(np.sum(colours * load))
    misfit += float(np.einsum("ic,ij,jc->", colours, normal, colours))
    pairs = zip(shadows.lamps, colours.tolist(), strict=True)
    lamps = [replace(lamp, colour=(r, g, b)) for lamp, (r, g, b) in pairs]
    return replace(shadows, lamps=lamps), misfit


def _turned(lamp: Lamp, by_rad: float) -> Lamp:
    return replace(lamp, azimuth_rad=lamp.azimuth_rad + by_rad)


def _raised(lamp: Lamp, by: float) -> Lamp:
    raised_rad = lamp.elevation_rad * math.exp(by)
    return replace(lamp, elevation_rad=min(max(raised_rad, _LOWEST_RAD), _HIGHEST_RAD))


def read_shadows(provenance: Mapping[str, Any]) -> ShadowCaster | None:
    """Return the lamps that a calibration's provenance names; None where it names none."""
    reader: TypeAdapter[ShadowCaster | None] = TypeAdapter(ShadowCaster | None)
    return reader.validate_python(provenance.get(SHADOWS))
