"""Calibration of the photometric model, and of the no-contact frame, from ball presses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from sim.optics.calibrate import circle_and_light as placing
from sim.optics.calibrate import photometric_least_squares as fitting
from sim.optics.calibrate.ball_press import BallPress, Circle, check_presses_fit
from sim.optics.calibrate.circle_and_light import PlacedPress, PredictedPixels, PressScene
from sim.optics.calibrate.gel_profile import ORTHOGRAPHIC, MotionModel
from sim.optics.colour.model_interface_and_response import LINEAR, Response
from sim.optics.colour.photometric import PhotometricModel, ShadingTerms
from sim.sensor.lamps_and_optics import ShadowCaster
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

_ROUNDS = 5  # how often circles are nudged and the model is fitted again


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """What a set of presses gave."""

    model: PhotometricModel
    scene: PressScene  # its no-contact frame is the mean of all frames, which has less noise
    circles: tuple[Circle, ...]  # nudged circles, in the order of the presses
    lights: FloatArray  # of each frame, see ``light_at`` [grey levels], [press_count, 3, 3]
    shadows: ShadowCaster | None = None  # None where the sensor shows none
    blur_px: float = 0.0  # standard deviation of the camera's blur [px]
    motion: MotionModel = ORTHOGRAPHIC

    def placed(self, presses: Sequence[BallPress]) -> list[PlacedPress]:
        """Return the presses that it was made of where they were found, in their light."""
        found = zip(presses, self.circles, self.lights, strict=True)
        return [PlacedPress(press=p, circle=circle, light=light) for p, circle, light in found]


def calibrate_optics(
    presses: Sequence[BallPress],
    scene: PressScene,
    start: Calibration | None = None,
    *,
    rounds: int = _ROUNDS,
) -> Calibration:
    """Fit model, circles, light and no-contact frame by turns, or further from a ``start``.

    Raises:
        ConfigError: There is no press, or one has another size than the no-contact frame.
    """
    if not presses:
        raise ConfigError("no ball press to calibrate from", remedy="give at least one, better 20")
    check_presses_fit(presses, scene.background.astype(np.uint8))
    if start is None:
        found = ((press, press.circle, scene.light(press, press.circle, None)) for press in presses)
        placed = [PlacedPress(press=p, circle=circle, light=light) for p, circle, light in found]
        averaged = scene
        model = fit_model(placed, scene)
    else:
        placed, averaged = start.placed(presses), start.scene
        model = fit_model(placed, averaged, start.model, settled=True)
    for turn in range(rounds):
        for i, each in enumerate(placed):
            lit = replace(each, light=averaged.light(each.press, each.circle, model))
            placed[i] = replace(lit, circle=averaged.nudged(lit, model))
        # Until the last round no other pixels are looked at.
        stride = 1 if turn == rounds - 1 else placing.STRIDE
        averaged = replace(scene, background=averaged_no_contact(placed, model, scene, stride))
        model = fit_model(placed, averaged, model, settled=start is not None)
    circles, lights = tuple(each.circle for each in placed), [each.light for each in placed]
    return Calibration(model=model, scene=averaged, circles=circles, lights=np.array(lights))


def fit_model(
    placed: Sequence[PlacedPress],
    scene: PressScene,
    known: PhotometricModel | None = None,
    *,
    blur_px: float = 0.0,
    settled: bool = False,
) -> PhotometricModel:
    """Fit response, lamps, ridge and coefficients where circles and lights are known.

    The search starts at an earlier model, whose response and ridge may be settled; without one the
    camera is taken to be linear and the ridge is the usual one. The camera's blur is not the gel's.
    """
    pressed = [PressSamples(scene, each, blur_px=blur_px) for each in placed]
    polynomial = [each.samples.polynomial(scene.exponents) for each in pressed]

    def features(terms: ShadingTerms | None) -> list[FloatArray]:
        pairs = zip(polynomial, pressed, strict=True)
        return [np.concatenate([values, each.samples.shading(terms)]) for values, each in pairs]

    def fitted(
        stand_in: PhotometricModel | None, terms: ShadingTerms | None, ridge: float | None
    ) -> PhotometricModel:
        return fitting.fit_photometric(
            [each.through(response, stand_in) for each in pressed],
            exponents=scene.exponents,
            features=features(terms),
            ridge=ridge,
            terms=terms,
            response=response,
            reference=fitting.REFERENCE,
        )

    response, terms, ridge = LINEAR, None, fitting.RIDGE if known is None else None
    if known is not None:
        terms, response = known.terms, known.response
        if settled:
            ridge = known.provenance["ridge"]
        else:
            response = fitting.fit_response(
                lambda tried: [each.through(tried) for each in pressed],
                features(terms),
                brightest=max(each.brightest for each in pressed),
            )
        if response != known.response:
            # Its light is not comparable with that of another response: begin anew.
            known = fitted(None, terms, fitting.RIDGE)
    if lamp_count := scene.lamp_count:
        seen = fitting.joined([each.through(response, known) for each in pressed])
        terms = fitting.fit_terms(seen, lamp_count=lamp_count, aspect=scene.aspect, start=terms)
    return fitted(known, terms, ridge)


def averaged_no_contact(
    placed: Sequence[PlacedPress], model: PhotometricModel, scene: PressScene, stride: int
) -> FloatArray:
    """Average every so many pixels of the no-contact frame over all frames outside contacts."""
    rows, columns = scene.lattice(stride)
    position, averaged = scene.normalised(columns, rows), scene.background.copy()
    total = averaged[rows, columns]
    count = np.ones_like(total)
    pixels = PredictedPixels(scene, model, columns, rows)
    for each in placed:
        image, circle = each.press.image[rows, columns], each.circle
        level = image - placing.light_at(each.light, position) - pixels.predict(circle)
        outside = circle.distance(columns, rows) > placing.BEYOND_RIM * circle.radius_px
        known = (outside & each.press.shown[rows, columns])[:, None] & placing.exposed(image)
        total += np.where(known, level, 0.0)
        count += known
    averaged[rows, columns] = total / count
    return averaged


class PressSamples:
    """Pixels around a contact; their surface is the same through every camera's response.

    Attributes:
        samples: Their surface, its colours not known yet.
        rows, columns: Which they are, shape [n].
        unloaded: Levels of the no-contact frame there, shape [n, 3].
        brightest: Level that nearly none of them exceeds.
    """

    def __init__(self, scene: PressScene, placed: PlacedPress, *, blur_px: float = 0.0) -> None:
        circle, image = placed.circle, placed.press.image
        rows, columns = scene.pixels_around(placed.press)
        self._scene, self._circle, self.rows, self.columns = scene, circle, rows, columns
        self.unloaded = scene.background[rows, columns]
        self._levels = image[rows, columns]
        self.brightest = float(np.quantile(self._levels, fitting.BRIGHT_QUANTILE))
        self._expected = scene.expected(rows, columns, placed.light)
        surface, shares = [scene.surface(circle, columns, rows)], [1.0]
        if blur_px > 0.0:
            # Four points around a pixel, whose mean a Gaussian blur is to third order.
            height, width = image.shape[:2]
            for right, down in product((-blur_px, blur_px), repeat=2):
                x = np.clip(columns + right, 0.0, width - 1.0)
                y = np.clip(rows + down, 0.0, height - 1.0)
                surface.append(scene.surface(circle, x, y))
            shares = [0.0, *[0.25] * 4]
        if (rest := scene.at_rest(columns, rows)) is not None:
            surface.append(rest)
            shares.append(-1.0)
        unknown = np.zeros_like(self._expected.T)
        self.samples = fitting.PhotometricSamples(
            surface=np.stack(surface).astype(np.float32),
            shares=tuple(shares),
            position=scene.normalised(columns, rows).astype(np.float32),
            change=unknown,
            weights=unknown,
        )

    def through(
        self, response: Response, model: PhotometricModel | None = None
    ) -> fitting.PhotometricSamples:
        """Return the samples with the light that the camera saw.

        A model stands in for pixels that are too bright or too dark for the camera; without one
        they do not count.
        """
        seen = placing.seen_change(self._levels, self._expected, response)
        gain = np.maximum(response.light(self.unloaded), 1.0) / fitting.REFERENCE
        telling = np.minimum(self._levels, placing.TELLING).astype(np.float64)
        change, weights = seen.change, gain * response.slope(telling)
        if model is None:
            weights *= seen.exposed
        else:
            lost = np.flatnonzero(~seen.exposed.all(axis=1))
            pixels = PredictedPixels(self._scene, model, self.columns[lost], self.rows[lost])
            predicted = change.copy()
            predicted[lost] = gain[lost] * pixels.light_change(self._circle)
            change = predicted - seen.misfit(predicted)  # as predicted where a bound allows it
        light, weight = (each.T.astype(np.float32) for each in (change / gain, weights))
        return replace(self.samples, change=light, weights=weight)
