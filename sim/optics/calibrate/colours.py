"""Calibration of the photometric model, and of the no-contact frame, from ball presses."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.optics.calibrate.fit.lamp_fit import fit_terms
from sim.optics.calibrate.fit.photometric_fit import (
    REFERENCE,
    RIDGE,
    fit_photometric,
    fit_response,
)
from sim.optics.calibrate.fit.samples import PhotometricSamples, joined
from sim.optics.calibrate.presses.ball_press import BallPress, Circle, check_presses_fit
from sim.optics.calibrate.presses.light import exposed
from sim.optics.calibrate.presses.press_samples import PressSamples
from sim.optics.calibrate.presses.scene import BEYOND_RIM, PressScene
from sim.optics.colour.photometric import PhotometricModel
from sim.optics.colour.response import LINEAR
from sim.optics.colour.shading_terms import ShadingTerms
from sim.sensor.optics import ShadowCaster
from tacauchy_rig.errors import ConfigError

log = logging.getLogger(__name__)

_FEW = 6000  # samples by which a response and lamps are searched for


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """What a set of presses gave.

    Attributes:
        model: Photometric model.
        scene: The scene with the no-contact frame averaged over all frames, which has less noise.
        circles: Nudged circles, in the order of the presses.
        lights: Light of each frame [grey levels], shape [press_count, 3, 3]; see ``light_at``.
        shadows: What the dents hide from the lamps; None where the sensor shows no shadows.
        blur_px: Standard deviation of the camera's blur [px].
    """

    model: PhotometricModel
    scene: PressScene
    circles: tuple[Circle, ...]
    lights: FloatArray
    shadows: ShadowCaster | None = None
    blur_px: float = 0.0


def calibrate_optics(
    presses: Sequence[BallPress],
    scene: PressScene,
    *,
    rounds: int = 3,
) -> Calibration:
    """Fit model, circles, light and no-contact frame by turns.

    Args:
        presses: Images with labelled circles.
        scene: Camera, no-contact frame and gel profile.
        rounds: How often circles are nudged and the model is fitted again.

    Raises:
        ConfigError: There is no press, or one has another size than the no-contact frame.
    """
    if not presses:
        raise ConfigError("no ball press to calibrate from", remedy="give at least one, better 20")
    check_presses_fit(presses, scene.background.astype(np.uint8))
    circles = [press.circle for press in presses]
    lights = [scene.light(p, c, None) for p, c in zip(presses, circles, strict=True)]
    model = fit_model(presses, circles, lights, scene, None)
    averaged = scene
    for turn in range(rounds):
        for i, press in enumerate(presses):
            lights[i] = averaged.light(press, circles[i], model)
            circles[i] = averaged.nudged(press, model, lights[i], circles[i])
        frame = averaged_no_contact(presses, circles, lights, model, scene)
        averaged = replace(scene, background=frame)
        model = fit_model(presses, circles, lights, averaged, model)
        log.debug("calibration round %d of %d done", turn + 1, rounds)
    return Calibration(model=model, scene=averaged, circles=tuple(circles), lights=np.array(lights))


def fit_model(
    presses: Sequence[BallPress],
    circles: Sequence[Circle],
    lights: Sequence[FloatArray] | FloatArray,
    scene: PressScene,
    known: PhotometricModel | None,
    *,
    blur_px: float = 0.0,
) -> PhotometricModel:
    """Fit response, lamps, ridge and coefficients where circles and lights are known.

    Args:
        presses: The images.
        circles: Their contacts.
        lights: Their light, each of shape [3, 3].
        scene: Camera, no-contact frame and gel.
        known: An earlier model, where the search starts; without one the camera is taken to be
            linear and the ridge is the usual one.
        blur_px: Standard deviation of the camera's blur, which is not the gel's [px].
    """
    exponents = scene.exponents
    found = list(zip(presses, circles, lights, strict=True))
    whole = [PressSamples(scene, *each, blur_px=blur_px) for each in found]
    every = max(1, sum(len(each.surface.change) for each in whole) // _FEW)
    few = [PressSamples(scene, *each, blur_px=blur_px, every=every) for each in found]
    polynomial = [each.surface.polynomial(exponents) for each in whole]
    if known is not None:
        known = _seen_through(known, whole, few, polynomial)
    response = LINEAR if known is None else known.response
    terms = _terms(joined([each.through(response, known) for each in few]), scene, known)
    return fit_photometric(
        [each.through(response, known) for each in whole],
        exponents=exponents,
        features=_with_terms(polynomial, whole, terms),
        ridge=RIDGE if known is None else None,
        terms=terms,
        response=response,
        reference=REFERENCE,
    )


def _seen_through(
    known: PhotometricModel,
    whole: Sequence[PressSamples],
    few: Sequence[PressSamples],
    polynomial: Sequence[FloatArray],
) -> PhotometricModel:
    """Return a model as the camera's response is now: begun anew where that has moved.

    Its light is not comparable with that of another response.
    """
    shapes = [each.surface.polynomial(known.exponents) for each in few]
    response = fit_response(
        lambda tried: [each.through(tried) for each in few], _with_terms(shapes, few, known.terms)
    )
    if response == known.response:
        return known
    return fit_photometric(
        [each.through(response) for each in whole],
        exponents=known.exponents,
        features=_with_terms(polynomial, whole, known.terms),
        terms=known.terms,
        response=response,
        reference=REFERENCE,
    )


def _with_terms(
    polynomial: Sequence[FloatArray], presses: Sequence[PressSamples], terms: ShadingTerms | None
) -> list[FloatArray]:
    """Return what the model is linear in, of each press."""
    pairs = zip(polynomial, presses, strict=True)
    return [np.concatenate([shape, press.surface.shading(terms)]) for shape, press in pairs]


def _terms(
    samples: PhotometricSamples, scene: PressScene, known: PhotometricModel | None
) -> ShadingTerms | None:
    if not scene.lamp_count:
        return None
    return fit_terms(
        samples,
        lamp_count=scene.lamp_count,
        aspect=scene.aspect,
        pixel_m=scene.geometry.mean_scale_m,
        start=None if known is None else known.terms,
    )


def averaged_no_contact(
    presses: Sequence[BallPress],
    circles: Sequence[Circle],
    lights: Sequence[FloatArray],
    model: PhotometricModel,
    scene: PressScene,
) -> FloatArray:
    """Average the no-contact frame over all frames outside their contacts.

    One frame has a camera's noise of one or two grey levels in every pixel, which a rendering over
    it would repeat; each press shows most of the gel as well, once its light and skirt are off.

    Args:
        presses: The images.
        circles: Their contacts.
        lights: Their light, each of shape [3, 3].
        model: Explains the skirts.
        scene: Holds the frame that was taken without contact.

    Returns:
        Grey levels, shape [height, width, 3].
    """
    height, width = scene.background.shape[:2]
    rows, columns = np.mgrid[:height, :width]
    total = scene.background.astype(np.float64)
    count = np.ones((height, width, 3))
    pixels = scene.whole_image(model)
    for press, circle, light in zip(presses, circles, lights, strict=True):
        change = pixels.predict(circle).reshape(total.shape)
        level = press.image - scene.light_image(light) - change
        reach = BEYOND_RIM * circle.radius_px
        outside = circle.distance(columns, rows)[..., None] > reach
        told = outside & exposed(press.image)
        if scene.masked is not None:
            told &= ~scene.masked[..., None]
        total += np.where(told, level, 0.0)
        count += told
    return np.asarray(total / count)
