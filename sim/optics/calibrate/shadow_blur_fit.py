"""Calibration of a sensor's optics from ball presses: colours, shadows where it has any, blur.

Colours and shadows are separated by turns: the residual of the smooth model of slopes is searched
for shadows of the lamps that the sensor's file names, and the model is fitted again to the presses
without those.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import combinations, product
from typing import Any

import cv2
import numpy as np
from pydantic import TypeAdapter

from sim.optics.calibrate import photometric_least_squares as fitting
from sim.optics.calibrate.ball_press import BallPress, Circle
from sim.optics.calibrate.circle_and_light import PlacedPress, PredictedPixels, PressScene, exposed
from sim.optics.calibrate.colour_fit import Calibration, PressSamples, calibrate_optics, fit_model
from sim.optics.calibrate.gel_profile import GelMotion, fit_motions, motion_terms
from sim.optics.markers.marker_tracking import find_markers
from sim.optics.render.lamp_rays import darkening, lost_share
from sim.sensor.lamps_and_optics import ShadowCaster
from tacauchy_rig.core.arrays import Float32Array, FloatArray, RealArray
from tacauchy_rig.core.errors import ConfigError

SHADOWS, BLUR_PX = "lamp_shadows", "blur_px"  # their names in a calibration's provenance
_EVERY_PX = 4  # pixels at which motion is evaluated; it is interpolated between
_LOOKED_AT = 10  # presses: the deepest at first, whose shadows are the longest, then of all depths
_COARSE = 2  # pixels along rows and columns that are taken together
_DIRECTIONS = 16  # around the gel, at which lamps are looked for besides those that are named
_KEPT = 24  # lamps whose shadows are kept in memory: more than are looked at together
_NEAR_SHARE = 1.5  # of the image's width: distance of lamps where a search starts
_BEFORE = 3  # rounds of colours and circles before shadows, which bring one more each
# In turn: of azimuth [rad] and of the logarithms of elevation, distance, a quarter of the spread
_ROUNDS = ((0.2, 0.1, 0.05), (0.05, 0.025, 0.0125))
_LOWEST_RAD, _HIGHEST_RAD = math.radians(3.0), math.radians(45.0)
# Where a shadow begins it is sharp, but for the blur; from there on lamps' size makes it softer.
_SOFTNESS_M, _SPREAD = 2e-5, 0.1
_BLUR_TURNS, _SHADED_TURNS = 5, 3  # the latter is beside each search for lamps
_SETTLED_PX, _LEAST_SHARE = 0.05, 0.2
_TRIED_PX = np.arange(0.0, 4.6, 0.5)
_MARGIN_PX = 10
_REACH = 1.4  # radii of the contact that are looked at
_STILL_RADII = 2.3  # from where markers look as they do at rest


def press_image(found: Calibration, circle: Circle, motion: GelMotion | None = None) -> FloatArray:
    """Return a press over the no-contact frame [grey levels], shape [height, width, 3].

    Shadows and colours change the light, the lens blurs it, the camera's response shows it, and
    markers take their share of it where the gel has carried them.
    """
    scene, model = found.scene, found.model
    light = model.response.light(scene.background)
    change = scene.whole_image(model).light_change(circle).reshape(light.shape)
    if found.shadows is not None:
        change = change + _darkened(found.shadows, scene, circle)
    change = _blurred(change * model.gain(light), found.blur_px)
    levels = np.asarray(model.response.levels(light + change), dtype=np.float64)
    if scene.markers is None:
        return levels
    return scene.markers.over(levels, gel_motion(found, circle, motion))


def gel_motion(found: Calibration, circle: Circle, motion: GelMotion | None) -> Float32Array:
    """Return by how much the gel that pixels see has moved [px], shape [2, height, width]."""
    coarse = found.scene.geometry.refined(1.0 / _EVERY_PX)
    rows, columns = np.mgrid[: coarse.height + 1, : coarse.width + 1].astype(np.float64)
    places = _EVERY_PX * (np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5) - 0.5
    shared, own = motion_terms(circle, found.scene.profile, found.scene.geometry, places)
    moved = np.tensordot(found.motion.factors, shared, axes=1)
    if motion is not None:
        moved = moved + np.tensordot(motion.own_px, own, axes=1)
    size = (_EVERY_PX * columns.shape[1], _EVERY_PX * rows.shape[0])
    planes = moved.astype(np.float32).T.reshape(2, *rows.shape)
    fine = np.stack([cv2.resize(each, size, interpolation=cv2.INTER_LINEAR) for each in planes])
    return fine[:, : found.scene.geometry.height, : found.scene.geometry.width]


def with_motion(presses: Sequence[BallPress], found: Calibration) -> Calibration:
    """Return a calibration that knows how markers move, and has their print from all frames."""
    scene, markers = found.scene, found.scene.markers
    placed = [each for each in found.placed(presses) if each.press.tracks is not None]
    if markers is None or not placed:
        return found
    tracks = [each.press.tracks for each in placed if each.press.tracks is not None]
    circles = [each.circle for each in placed]
    model, motions = fit_motions(tracks, circles, scene.profile, scene.geometry)
    found, total = replace(found, motion=model), markers.frame.astype(np.float64)
    count = np.ones(total.shape[:2])
    rows, columns = np.mgrid[: total.shape[0], : total.shape[1]]
    for each, motion in zip(placed, motions, strict=True):
        still = each.circle.distance(columns, rows) > _STILL_RADII * each.circle.radius_px
        x, y = np.stack([columns, rows]).astype(np.float32) + gel_motion(found, each.circle, motion)
        level = each.press.image - scene.frame_light_image(each.light)
        seen = cv2.remap(level, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        total += still[..., None] * seen
        count += still
    frame = np.clip(np.rint(total / count[..., None]), 0, 255).astype(np.uint8)
    return replace(found, scene=replace(scene, markers=find_markers(frame) or markers))


def without_shadows(press: BallPress, circle: Circle, found: Calibration) -> BallPress:
    """Return the press with the light that its dent took away."""
    if found.shadows is None:
        return press
    gain = found.model.gain(found.model.response.light(found.scene.background))
    taken = _blurred(_darkened(found.shadows, found.scene, circle) * gain, found.blur_px)
    image = np.clip(np.rint(press.image - taken), 0, 255)
    return replace(press, image=image.astype(np.uint8))


def _darkened(shadows: ShadowCaster, scene: PressScene, circle: Circle) -> Float32Array:
    """Return the light that a press takes away over the model's reference, [height, width, 3]."""
    gel = scene.pressed_image(circle).astype(np.float32)
    return darkening(shadows, gel[2], gel[:2], scene.geometry).transpose(1, 2, 0)


def _blurred(light: RealArray, blur_px: float) -> FloatArray:
    """Return light as a camera of this blur [px] sees it, same shape."""
    seen = cv2.GaussianBlur(light, (0, 0), blur_px) if blur_px > 0.0 else light
    return np.asarray(seen, dtype=np.float64)


def calibrate_with_shadows(
    presses: Sequence[BallPress], scene: PressScene, nominal: ShadowCaster
) -> Calibration:
    """Fit colours, place, size, softness and colour of the lamps' shadows, and the blur.

    The search starts at the lamps of the sensor's file, or at others all around the gel where those
    explain more.
    """
    found = calibrate_optics(presses, scene, rounds=_BEFORE)
    shadows = replace(nominal, softness_m=_SOFTNESS_M, spread=_SPREAD)
    for steps in _ROUNDS:
        shadows = _fitted(presses, found, shadows, steps)
        known = replace(found, shadows=shadows)
        lit = [without_shadows(*pair, known) for pair in zip(presses, known.circles, strict=True)]
        known = calibrate_optics(lit, scene, found, rounds=1)
        known = replace(known, shadows=shadows, blur_px=found.blur_px)
        found = _coloured(presses, with_blur(known.placed(lit), known, turns=_SHADED_TURNS))
    return found


def _coloured(presses: Sequence[BallPress], found: Calibration) -> Calibration:
    """Fit the colours of slopes and of shadows together, where lamps and contacts are known."""
    scene, model, shadows = found.scene, found.model, found.shadows
    if shadows is None or model.terms is None:
        return found
    seen, features = [], []
    for each in found.placed(presses):
        pressed = PressSamples(scene, each, blur_px=found.blur_px)
        seen.append(pressed.through(model.response, model))
        gel = scene.pressed_image(each.circle).astype(np.float32)[None]
        dent, at = (gel[:, 2], gel[:, :2]), (pressed.rows, pressed.columns)
        shares = (lost_share(*dent, lamp, shadows, scene.geometry)[0] for lamp in shadows.lamps)
        lost = np.stack([-_blurred(share, found.blur_px)[at] for share in shares])
        slopes = seen[-1].polynomial(scene.exponents), seen[-1].shading(model.terms)
        features.append(np.concatenate([*slopes, lost]))
    together = fitting.fit_photometric(
        seen,
        exponents=scene.exponents,
        features=features,
        ridge=None,
        terms=model.terms,
        response=model.response,
        reference=fitting.REFERENCE,
    )
    own, colours = np.split(together.term_coefficients, [model.terms.count])
    fitted = replace(together, term_coefficients=own)
    return replace(found, model=fitted, shadows=_with_colours(shadows, colours))


def _with_colours(shadows: ShadowCaster, colours: FloatArray) -> ShadowCaster:
    """Give lamps colours, shape [lamp_count, 3]; none is below zero."""
    pairs = zip(shadows.lamps, np.maximum(colours, 0.0).tolist(), strict=True)
    return replace(shadows, lamps=[replace(lamp, colour=(r, g, b)) for lamp, (r, g, b) in pairs])


def _fitted(
    presses: Sequence[BallPress], found: Calibration, start: ShadowCaster, steps: Sequence[float]
) -> ShadowCaster:
    """Search where lamps stand, one after the other, and how large; colours follow linearly."""
    placed = sorted(found.placed(presses), key=lambda each: -each.circle.radius_px)
    every = -(-len(placed) // _LOOKED_AT)
    lost = _LostLight(placed[::every] if found.shadows else placed[:_LOOKED_AT], found)
    best = start if found.shadows else lost.best_of(start)
    distance_m = _NEAR_SHARE * found.scene.geometry.width * found.scene.geometry.scale_x_m
    near = [replace(lamp, distance_m=lamp.distance_m or distance_m) for lamp in best.lamps]
    best, misfit = lost.coloured(replace(best, lamps=near))
    for step in steps:
        names = ("azimuth_rad", "elevation_rad", "distance_m")
        moves = [*product(names, range(len(best.lamps))), ("spread", 0)]
        for (name, index), by in product(moves, (-step, step)):
            while True:
                tried, error = lost.coloured(_moved(best, name, index, by))
                if error >= misfit:
                    break
                best, misfit = tried, error
    return best


class _LostLight:
    """What lamps lose by some presses, compared with the light that is seen.

    Colours by slopes are fitted anew beside each trial of the lamps (variable projection): they
    take up a part of any shadow, and only the rest tells where lamps stand.
    """

    def __init__(self, placed: Sequence[PlacedPress], found: Calibration) -> None:
        scene, model = found.scene, found.model
        self._geometry = scene.geometry.refined(1.0 / _COARSE)
        height, width = scene.background.shape[:2]
        size = (width // _COARSE, height // _COARSE)
        gels = (scene.pressed_image(each.circle)[:3].astype(np.float32) for each in placed)
        area = cv2.INTER_AREA
        small = [[cv2.resize(each, size, interpolation=area) for each in gel] for gel in gels]
        self._dents = np.array(small)  # tilt (2) and bulge [m], shape [press, 3, height, width]
        self._blur_px = found.blur_px / _COARSE
        pressed = [PressSamples(scene, each, blur_px=found.blur_px) for each in placed]
        self._places = [(each.rows // _COARSE, each.columns // _COARSE) for each in pressed]
        seen = fitting.joined([each.through(model.response, model) for each in pressed])
        features = np.concatenate([seen.polynomial(scene.exponents), seen.shading(model.terms)])
        self._weights, self._features = seen.weights, features
        hold = model.provenance["ridge"] * features.shape[1] * np.eye(len(features))
        weighted = (features * weight for weight in seen.weights)
        self._factors = [np.linalg.inv(each @ each.T + hold) for each in weighted]
        self._left_over = self._beside(seen.change * seen.weights)
        self._total = float(np.sum(self._left_over**2))
        self._lost = lru_cache(_KEPT)(self._lost_by)

    def _beside(self, light: RealArray) -> RealArray:
        """Return what of weighted colours, shape [3, n], no colours by slopes explain."""
        f, found = self._features, light.astype(np.float32)
        for each, weights, inverse in zip(found, self._weights, self._factors, strict=True):
            colours = inverse @ (f @ (weights * each))
            each -= colours.astype(np.float32) @ f * weights
        return found

    def best_of(self, start: ShadowCaster) -> ShadowCaster:
        """Return as many lamps as are named that explain most, of these and of others all around.

        A search from lamps that are far off would end with two of them at the same shadow.
        """
        named = start.lamps
        raised_rad = float(np.mean([lamp.elevation_rad for lamp in named]))
        usual = replace(named[0], elevation_rad=raised_rad)
        around = np.linspace(-math.pi, math.pi, _DIRECTIONS, endpoint=False).tolist()
        lamps = [*named, *(replace(usual, azimuth_rad=at) for at in around)]
        normal, load = self._equations(replace(start, lamps=lamps))
        choices = [list(each) for each in combinations(range(len(lamps)), len(named))]
        misfits = [_colours(normal[:, each][:, :, each], load[:, each])[1] for each in choices]
        best = choices[int(np.argmin(misfits))]
        return replace(start, lamps=[lamps[index] for index in best])

    def coloured(self, shadows: ShadowCaster) -> tuple[ShadowCaster, float]:
        """Give lamps the colours that explain best what is left over; return the misfit too."""
        colours, misfit = _colours(*self._equations(shadows))
        return _with_colours(shadows, colours), self._total + misfit

    def _equations(self, shadows: ShadowCaster) -> tuple[FloatArray, FloatArray]:
        dark = [replace(lamp, colour=(0.0, 0.0, 0.0)) for lamp in shadows.lamps]
        each = [self._lost(replace(shadows, lamps=(lamp,))) for lamp in dark]
        terms = np.stack(each, axis=1)
        normal = terms @ terms.transpose(0, 2, 1)
        return normal, -np.einsum("cln,cn->cl", terms, self._left_over)

    def _lost_by(self, shadows: ShadowCaster) -> RealArray:
        """Return what one lamp loses, whatever its colour, beside colours by slopes, [3, n]."""
        gel, (lamp,) = self._dents, shadows.lamps
        shares = lost_share(gel[:, 2], gel[:, :2], lamp, shadows, self._geometry)
        pairs = zip(shares, self._places, strict=True)
        seen = [_blurred(share, self._blur_px)[place] for share, place in pairs]
        return self._beside(self._weights * np.concatenate(seen))


def _colours(normal: FloatArray, load: FloatArray) -> tuple[FloatArray, float]:
    """Return colours, none below zero, that solve normal equations, and what they change.

    The equations have the shapes [3, lamp_count, lamp_count] and [3, lamp_count], colours
    [lamp_count, 3].
    """
    pairs = zip(normal, load, strict=True)
    colours = np.maximum([np.linalg.lstsq(n, b, rcond=None)[0] for n, b in pairs], 0.0)
    change = np.einsum("ci,cij,cj->", colours, normal, colours) - 2.0 * np.sum(colours * load)
    return colours.T, float(change)


def _moved(shadows: ShadowCaster, name: str, index: int, by: float) -> ShadowCaster:
    """Change a lamp's azimuth by an angle, its elevation or distance by a factor, or the spread."""
    if name == "spread":
        return replace(shadows, spread=shadows.spread * math.exp(4.0 * by))
    lamps = list(shadows.lamps)
    value = getattr(lamps[index], name)
    value = value + by if name == "azimuth_rad" else value * math.exp(by)
    if name == "elevation_rad":
        value = min(max(value, _LOWEST_RAD), _HIGHEST_RAD)
    lamps[index] = replace(lamps[index], **{name: value})
    return replace(shadows, lamps=lamps)


def read_shadows(provenance: Mapping[str, Any]) -> ShadowCaster | None:
    """Return the lamps that a calibration's provenance names; None where it names none.

    Raises:
        ConfigError: Their light is in grey levels, as it was before it followed the frame's light.
    """
    if provenance.get("shadows"):
        raise ConfigError(
            "an older version wrote this calibration, whose shadows have another strength",
            remedy="calibrate again with: tacauchy-rig calibrate optics",
        )
    reader: TypeAdapter[ShadowCaster | None] = TypeAdapter(ShadowCaster | None)
    return reader.validate_python(provenance.get(SHADOWS))


def calibrate_presses(
    presses: Sequence[BallPress],
    scene: PressScene,
    shadows: ShadowCaster | None,
    *,
    blurred: bool = True,
) -> Calibration:
    """Fit colours, shadows where the sensor's file says that there are any, and the blur.

    Args:
        shadows: Lamps of the sensor's file that cast some; None is a sensor that shows none.
        blurred: Find the camera's blur too.

    Raises:
        ConfigError: As ``calibrate_optics``.
    """
    if shadows is None:
        found = calibrate_optics(presses, scene)
        if blurred:
            found = with_blur(found.placed(presses), found, turns=_BLUR_TURNS)
    else:
        found = calibrate_with_shadows(presses, scene, shadows)
    return with_motion(presses, found)


def with_blur(placed: Sequence[PlacedPress], found: Calibration, *, turns: int) -> Calibration:
    """Return a calibration with the camera's blur, and colours fitted to the gel as it shows it.

    Presses are without shadows. The search starts at the blur that is known. Each turn makes up a
    share of what is missing, which the turn before tells (secant method).
    """
    blur_px, sharp = found.blur_px, replace(found, blur_px=0.0)
    before_px, missed_px = 0.0, 0.0
    for turn in range(turns):
        if blur_px > 0.0:
            # The colours once more, to the gel as the blur shows it: or they take a part of it.
            model = fit_model(placed, found.scene, found.model, blur_px=blur_px, settled=True)
            found = replace(found, model=model)
        shown_px = fit_blur(placed, found)
        if shown_px == 0.0:
            return sharp  # colours fitted to a blur that is none after all would be off
        missing_px = shown_px - blur_px
        share = (missed_px - missing_px) / (blur_px - before_px) if turn else 1.0
        before_px, missed_px = blur_px, missing_px
        blur_px = min(blur_px + missing_px / min(max(share, _LEAST_SHARE), 1.0), _TRIED_PX[-1])
        if abs(blur_px - before_px) < _SETTLED_PX:
            break
    return replace(found, blur_px=blur_px)


def fit_blur(placed: Sequence[PlacedPress], found: Calibration) -> float:
    """Return the standard deviation of the blur that explains the presses best [px].

    Lens, sensor and JPEG spread each point of the gel over its neighbours; a ball shows it where
    its contact ends. The model, fitted to the same images, takes up a part of a blur, and blur a
    part of the model's error: this is what makes renderings agree best, no measurement of a lens.
    """
    misfit, scene = np.zeros(len(_TRIED_PX)), found.scene
    for each in placed:
        press, circle = each.press, each.circle
        reach = _REACH * circle.radius_px + _MARGIN_PX
        spans = ((int(at - reach), int(at + reach) + 2) for at in (circle.y_px, circle.x_px))
        window = tuple(slice(max(0, first), end) for first, end in spans)
        rows, columns = np.indices(press.image.shape[:2])[:, *window]
        near = circle.distance(columns, rows) < _REACH * circle.radius_px
        image = press.image[window]
        known = (near & press.shown[window])[..., None] & exposed(image)
        rows, columns = rows.ravel(), columns.ravel()
        seen = image - scene.expected(rows, columns, each.light).reshape(image.shape)
        pixels = PredictedPixels(scene, found.model, columns, rows)
        sharp = pixels.predict(circle).reshape(seen.shape)
        blurs = [cv2.GaussianBlur(sharp, (0, 0), s) if s > 0.0 else sharp for s in _TRIED_PX]
        misfit += [np.abs(seen - blurred)[known].sum() for blurred in blurs]
    # A blur beyond those tried is larger than cameras have: something else is wrong then.
    at_an_end = int(np.argmin(misfit)) in (0, len(misfit) - 1)
    return 0.0 if at_an_end else fitting.lowest_place(_TRIED_PX, misfit)
