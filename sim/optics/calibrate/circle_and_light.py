"""What a ball press looks like through a photometric model: its circle, and its frame's light."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.optimize import least_squares, minimize

from sim.optics.calibrate.ball_press import BallPress, Circle
from sim.optics.calibrate.gel_profile import GelMotion, GelProfile, ball_profiles, rest_slopes
from sim.optics.colour.model_interface_and_response import LINEAR, Response
from sim.optics.colour.nominal_optics import exponents_for, lamp_count_of
from sim.optics.colour.photometric import PhotometricModel
from sim.optics.markers import marker_tracking
from sim.scene.scene import Preset
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor
from tacauchy_rig.core.arrays import (
    AnyArray,
    BoolArray,
    FloatArray,
    ImageArray,
    IndexArray,
    IntArray,
    RealArray,
)
from tacauchy_rig.core.errors import ConfigError

_LIGHT_ROUNDS = 3
_LIGHT_OUTLIER_LEVELS = 10.0
_DARKEST, _BRIGHTEST = 1, 254
TELLING = 251  # of a compressed range the last levels tell less than their noise
BEYOND_RIM = 1.15
LARGEST = 1.03  # of a ball's radius: circles and scales are not exact, but no contact is larger
STRIDE = 4  # of the pixels along rows and columns that are used for fitting
_FAR_FRACTION = 0.7
_SKIRT_RADII = 2.3
_OUTLIER_LEVELS = 15.0
_CLICK_WEIGHT = 0.1
_SEARCH_PX = 100.0
# Differences that slopes are found by, and what ends a search, are shares of the move plus this;
# ``ftol`` is one of what is left over: 0.01 px change it by as much.
_SEARCH: dict[str, Any] = {"diff_step": 3e-4, "xtol": 1e-5, "ftol": 1e-4, "max_nfev": 10}
# Of a contact that nobody has labelled:
_SMOOTHING_PX = 2.0
_RADII = (0.25, 0.45, 0.65)  # of contacts to start from, in radii of the ball
_FOUND_PX = 0.02  # to which it is found
_FAINTEST_LEVELS = 4.0
_STRONG_QUANTILE = 0.97  # of the changes, where a search for the contact starts
_LEAST_EXPLAINED = 0.3  # of the changes' variance


def light_at(light: FloatArray, position: FloatArray) -> FloatArray:
    """Evaluate a frame's light, shape [n, 3], at normalised pixel positions, shape [2, n].

    Its rows: level, and change from the middle to the right and to the bottom border [grey levels].
    """
    return np.asarray(light[0] + position.T @ light[1:])


def _fit_light(seen: SeenChange, position: FloatArray, *, level_only: bool) -> FloatArray:
    """Fit the plane of ``light_at``, bounding outliers; a part of the image fixes no gradient."""
    terms = np.column_stack([np.ones(position.shape[1]), position.T * (not level_only)])
    light = []
    for change, known in zip(seen.change.T, seen.exposed.T, strict=True):
        weight = known.astype(np.float64)
        for _ in range(_LIGHT_ROUNDS):
            weighted = (terms * weight[:, None]).T
            plane = np.linalg.lstsq(weighted @ terms, weighted @ change, rcond=None)[0]
            weight = known / (1.0 + ((change - terms @ plane) / _LIGHT_OUTLIER_LEVELS) ** 2)
        light.append(plane)
    return np.stack(light, axis=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenChange:
    """How pixels differ from the no-contact frame."""

    change: FloatArray  # red, green, blue [grey levels], shape [n, 3]
    over: BoolArray  # true where the pixel is at the top of its range: the change is at least this
    under: BoolArray  # true where it is at the bottom: the change is at most this

    @property
    def exposed(self) -> BoolArray:
        """True where the change is known, shape [n, 3]."""
        return ~(self.over | self.under)

    def misfit(self, predicted: RealArray) -> FloatArray:
        """Return predicted minus seen change, zero where a clipped pixel allows it, [n, 3]."""
        off = predicted - self.change
        off = np.where(self.over, np.minimum(off, 0.0), off)
        return np.where(self.under, np.maximum(off, 0.0), off)


def seen_change(
    levels: ImageArray, expected: FloatArray, response: Response = LINEAR
) -> SeenChange:
    """Compare the light of pixels with what it would be without contact; both of shape [n, 3]."""
    top = TELLING if response.bends else _BRIGHTEST
    light = response.light(np.minimum(levels, top).astype(np.float64))
    change = light - response.light(expected)
    return SeenChange(change=change, over=levels >= top, under=levels <= _DARKEST)


def exposed(levels: ImageArray) -> BoolArray:
    """Return True where pixels are inside the camera's range, same shape."""
    return (levels > _DARKEST) & (levels < _BRIGHTEST)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedPress:
    """A press as it was labelled, with what was found of it."""

    press: BallPress
    circle: Circle  # its contact's edge, labelled or nudged
    light: FloatArray  # of its frame [grey levels], as ``light_at`` has it, shape [3, 3]
    motion: GelMotion | None = None  # how ball and image were moved; None where no marker tells


@dataclass(frozen=True, slots=True, kw_only=True)
class PressScene:
    """Camera, no-contact frame and gel that all presses of a set share."""

    geometry: CameraGeometry
    background: FloatArray  # no-contact frame without markers, RGB levels, [height, width, 3]
    profile: GelProfile
    exponents: IntArray
    markers: marker_tracking.PrintedMarkers | None = None  # None where the frame shows none
    # dz/d(column) and dz/d(row) of the unloaded gel [1], [2, height, width]; None is level
    rest_slope: FloatArray | None = None
    lamp_count: int = 0  # near lamps that the model may have; with none it is a polynomial alone

    def over(self, unloaded: ImageArray) -> PressScene:
        """Return the scene over another no-contact frame, RGB."""
        markers = marker_tracking.find_markers(unloaded)
        bare = unloaded if markers is None else markers.bare
        return replace(self, background=bare.astype(np.float64), markers=markers)

    @property
    def aspect(self) -> float:
        """Height of the image over its width."""
        height, width = self.background.shape[:2]
        scale = self.geometry.scale_y_m / self.geometry.scale_x_m
        return float((height - 1) * scale / (width - 1))

    def surface(self, circle: Circle, columns: AnyArray, rows: AnyArray) -> FloatArray:
        """Return tilt (2), indentation [m] and curvature [1/m] of the gel at pixels, shape [4, n].

        On sloping gel the contact is that on level gel leaned: slopes at rest and pressed add up.
        """
        dx = (columns - circle.x_px) * self.geometry.scale_x_m
        dy = (rows - circle.y_px) * self.geometry.scale_y_m
        r = np.hypot(dx, dy)
        profile = self.profile(circle.radius_px * self.geometry.mean_scale_m)
        outward = np.interp(r, profile.radius_m, profile.tilt, right=0.0) / np.maximum(r, 1e-12)
        indentation = np.interp(r, profile.radius_m, profile.indentation_m, right=0.0)
        curvature = profile.curvature(r, width_m=self.geometry.mean_scale_m)
        tilt = np.stack([dx * outward, dy * outward])
        if self.rest_slope is not None:
            upright = np.sqrt(np.maximum(1.0 - np.sum(tilt**2, axis=0), 1e-6))
            tilt = _tilt_of(tilt / upright + _slope_at(self.rest_slope, columns, rows))
        return np.stack([*tilt, indentation, curvature])

    def at_rest(self, columns: AnyArray, rows: AnyArray) -> FloatArray | None:
        """Return ``surface`` of the unloaded gel at pixels; None where it is level."""
        if self.rest_slope is None:
            return None
        tilt = _tilt_of(_slope_at(self.rest_slope, columns, rows))
        return np.concatenate([tilt, np.zeros_like(tilt)])

    def pressed_image(self, circle: Circle) -> FloatArray:
        """Return ``surface`` of the whole image, shape [4, height, width]."""
        rows, columns = self.lattice(1)
        return self.surface(circle, columns, rows).reshape(4, *self.background.shape[:2])

    def reach_px(self, circle: Circle) -> float:
        """Return how far from a contact's centre the gel moves [px]."""
        geometry = self.geometry
        profile = self.profile(circle.radius_px * geometry.mean_scale_m)
        scale_m = min(geometry.scale_x_m, geometry.scale_y_m)
        return float(profile.radius_m[-1]) / scale_m + 1.0

    def whole_image(self, model: PhotometricModel) -> PredictedPixels:
        """Return all pixels, row after row, made ready to be predicted."""
        rows, columns = self.lattice(1)
        return PredictedPixels(self, model, columns, rows)

    def frame_light_image(self, light: FloatArray) -> FloatArray:
        """Return a frame's light everywhere, shape [height, width, 3]."""
        rows, columns = self.lattice(1)
        return light_at(light, self.normalised(columns, rows)).reshape(self.background.shape)

    @property
    def frame(self) -> FloatArray:
        """The no-contact frame with its markers, as float, shape [height, width, 3]."""
        return self.background if self.markers is None else self.markers.over(self.background)

    def normalised(self, columns: AnyArray, rows: AnyArray) -> FloatArray:
        """Return pixel positions as the model wants them, in [-1, 1], shape [2, n]."""
        height, width = self.background.shape[:2]
        return np.stack([2.0 * columns / (width - 1) - 1.0, 2.0 * rows / (height - 1) - 1.0])

    def pixels_around(self, press: BallPress) -> tuple[IndexArray, IndexArray]:
        """Return rows and columns of the fitting lattice in a press's contact and skirt."""
        rows, columns = self.lattice(STRIDE)
        near = press.circle.distance(columns, rows) < _SKIRT_RADII * press.circle.radius_px
        near &= press.shown[rows, columns]
        return rows[near], columns[near]

    def lattice(self, stride: int) -> tuple[IndexArray, IndexArray]:
        """Return rows and columns of every so many pixels along both."""
        height, width = self.background.shape[:2]
        rows, columns = np.mgrid[:height:stride, :width:stride]
        return rows.ravel(), columns.ravel()

    def expected(self, rows: IndexArray, columns: IndexArray, light: FloatArray) -> FloatArray:
        """Return levels of a frame's unloaded gel at pixels of the image, shape [n, 3]."""
        position = self.normalised(columns, rows)
        return np.asarray(self.background[rows, columns] + light_at(light, position))

    def followed(self, press: BallPress) -> BallPress:
        """Return a press with its markers followed, and where they hide the gel."""
        if self.markers is None:
            return press
        tracks = marker_tracking.follow_markers(self.markers, press.image)
        return replace(press, tracks=tracks, hidden=marker_tracking.hidden_by(self.markers, tracks))

    def light(self, press: BallPress, circle: Circle, model: PhotometricModel | None) -> FloatArray:
        """Estimate the frame's light, see ``light_at``, outside the contact.

        A model explains the skirt; without one, the farthest pixels are taken to be level.
        """
        rows, columns = self.lattice(STRIDE)
        distance = circle.distance(columns, rows)
        edge = np.quantile(distance, _FAR_FRACTION) if model is None else 0.0
        outside = distance > max(float(edge), BEYOND_RIM * circle.radius_px)
        outside &= press.shown[rows, columns]
        rows, columns = rows[outside], columns[outside]
        seen = seen_change(press.image[rows, columns], self.background[rows, columns])
        if model is not None:
            moved = distance[outside] < self.reach_px(circle)
            pixels = PredictedPixels(self, model, columns[moved], rows[moved])
            seen.change[moved] -= pixels.predict(circle)
        return _fit_light(seen, self.normalised(columns, rows), level_only=model is None)

    def nudged(self, placed: PlacedPress, model: PhotometricModel) -> Circle:
        """Move a circle to where the model explains the image best; its label pulls weakly."""
        label = np.array(placed.press.circle)
        rows, columns = self.pixels_around(placed.press)
        expected = self.expected(rows, columns, placed.light)
        seen = seen_change(placed.press.image[rows, columns], expected)
        pull = _CLICK_WEIGHT * np.sqrt(seen.change.size)
        pixels = PredictedPixels(self, model, columns, rows)

        def residual(numbers: FloatArray) -> FloatArray:
            move = numbers - _SEARCH_PX
            misfit = seen.misfit(pixels.predict(_circle(label + move))).ravel()
            bounded = _OUTLIER_LEVELS * np.tanh(misfit / _OUTLIER_LEVELS)
            return np.concatenate([bounded, pull * move])

        start = np.array(placed.circle) - label + _SEARCH_PX
        found = least_squares(residual, start, **_SEARCH)
        return _circle(label + found.x - _SEARCH_PX)


def _circle(numbers: FloatArray) -> Circle:
    """Return the circle of a search's numbers: column, row and radius [px], at least 1 px."""
    x, y, radius = numbers.tolist()
    return Circle(x_px=x, y_px=y, radius_px=max(radius, 1.0))


def _tilt_of(slope: FloatArray) -> FloatArray:
    return np.asarray(slope / np.sqrt(1.0 + np.sum(slope**2, axis=0)))


def _slope_at(slope: FloatArray, columns: AnyArray, rows: AnyArray) -> FloatArray:
    return slope[:, np.rint(rows).astype(np.intp), np.rint(columns).astype(np.intp)]


class PredictedPixels:
    """Pixels of a scene, columns and rows of shape [n], through a model, whatever is pressed."""

    def __init__(
        self, scene: PressScene, model: PhotometricModel, columns: IndexArray, rows: IndexArray
    ) -> None:
        self._scene, self._model, self._columns, self._rows = scene, model, columns, rows
        self._position = scene.normalised(columns, rows).astype(np.float32)
        self._light = model.response.light(scene.background[rows, columns].astype(np.float32))
        self._gain, rest = model.gain(self._light), scene.at_rest(columns, rows)
        self._rest_change = None if rest is None else self._modelled(rest, self._position)

    def light_change(self, circle: Circle) -> RealArray:
        """Return the model's change of light over its reference, shape [n, 3]."""
        distance = circle.distance(self._columns, self._rows)
        moved = np.flatnonzero(distance < self._scene.reach_px(circle))
        gel = self._scene.surface(circle, self._columns[moved], self._rows[moved])
        found, change = np.zeros_like(self._light), self._modelled(gel, self._position[:, moved])
        found[moved] = change if self._rest_change is None else change - self._rest_change[moved]
        return found

    def predict(self, circle: Circle) -> RealArray:
        """Return the model's colour change [grey levels], shape [n, 3]."""
        levels = self._model.response.levels
        return levels(self._light + self._gain * self.light_change(circle)) - levels(self._light)

    def _modelled(self, gel: FloatArray, position: RealArray) -> RealArray:
        tilt, (depth_m, curvature) = np.split(gel.astype(np.float32), [2])
        return self._model.evaluate(tilt, position, depth_m, curvature).T


def pressed_scene(
    sensor: Sensor,
    unloaded: ImageArray,
    geometry: CameraGeometry,
    *,
    ball_diameter_m: float,
    preset: Preset = Preset.FAST,
    on_press: Callable[[int], None] = lambda _: None,
) -> PressScene:
    """Press the ball in the simulator, and put camera, no-contact frame and gel together.

    Raises:
        ConfigError: The sensor's renderer cannot be calibrated.
        ConvergenceError: As ``ball_profiles``.
    """
    exponents = exponents_for(sensor)  # before anything is simulated
    return PressScene(
        exponents=exponents,
        lamp_count=lamp_count_of(sensor),
        geometry=geometry,
        background=unloaded.astype(np.float64),
        profile=ball_profiles(
            sensor, ball_diameter_m=ball_diameter_m, preset=preset, on_press=on_press
        ),
        rest_slope=rest_slopes(sensor.pad, geometry),
    ).over(unloaded)


def wrong_label(press: BallPress, scene: PressScene, *, ball_radius_m: float) -> str | None:
    """Return what contradicts a press's label; None where its image shows the contact there.

    A contact that contradicts it is farther away than the label's radius.
    """
    change, label = _ContactChange(press, scene), press.circle
    if label.distance(*change.start) < label.radius_px:
        return None
    found, explained = change.search(ball_radius_m)
    as_labelled = change.explained(label)
    is_near = label.distance(found.x_px, found.y_px) < label.radius_px
    if is_near or explained < _LEAST_EXPLAINED or explained < 2.0 * as_labelled:
        return None
    return (
        f"{press.name} was left out: its label says column {label.x_px:.0f}, row "
        f"{label.y_px:.0f}, radius {label.radius_px:.0f} px, but the image shows the contact "
        f"at {found.x_px:.0f}, {found.y_px:.0f}, radius {found.radius_px:.0f} px, which "
        f"explains {explained:.0%} of the change of colour, the label {as_labelled:.0%}; correct "
        "the label"
    )


def find_circle(press: BallPress, scene: PressScene, *, ball_radius_m: float) -> Circle:
    """Find the contact by how strongly the colour changes, whatever the lights' colours are.

    It changes about in proportion to the tilt that the gel has around the circle.

    Raises:
        ConfigError: The image shows no contact.
    """
    change = _ContactChange(press, scene)
    found, explained = change.search(ball_radius_m)
    height, width = press.image.shape[:2]
    largest = LARGEST * ball_radius_m / scene.geometry.mean_scale_m
    inside = 0.0 <= found.x_px < width and 0.0 <= found.y_px < height
    inside &= 1.0 < found.radius_px < largest
    if not inside or change.strongest < _FAINTEST_LEVELS or explained < _LEAST_EXPLAINED:
        raise ConfigError(
            f"{press.name} shows no contact of a ball that can be found",
            remedy="remove the image, or give its circle in a table: --circles circles.csv",
        )
    return found


class _ContactChange:
    """How strongly the colour of an image changes, and which contact explains that."""

    def __init__(self, press: BallPress, scene: PressScene) -> None:
        known = press.shown
        change = press.image - scene.background
        change = change - np.median(change[known], axis=0)  # that of the frame's light
        weight = ndimage.gaussian_filter(known.astype(np.float64), _SMOOTHING_PX)
        change = np.where(known[..., None], change, 0.0)
        smooth = ndimage.gaussian_filter(change, (_SMOOTHING_PX, _SMOOTHING_PX, 0.0))
        smooth = smooth / np.maximum(weight, 1e-3)[..., None]
        rows, columns = np.nonzero(known[::STRIDE, ::STRIDE])
        self._y, self._x = rows * float(STRIDE), columns * float(STRIDE)
        seen = np.linalg.norm(smooth[::STRIDE, ::STRIDE], axis=2)[rows, columns]
        strong = seen >= np.quantile(seen, _STRONG_QUANTILE)
        self._seen, self.strongest = seen - seen.mean(), float(seen.max())  # [grey levels]
        # Column and row of the middle of the strongest changes [px]
        self.start = np.median(self._x[strong]), np.median(self._y[strong])
        self._profile, self._geometry = scene.profile, scene.geometry

    def explained(self, circle: Circle) -> float:
        """Return which share of the changes' variance the gel's tilt around a contact explains."""
        profile = self._profile(circle.radius_px * self._geometry.mean_scale_m)
        dx = (self._x - circle.x_px) * self._geometry.scale_x_m
        dy = (self._y - circle.y_px) * self._geometry.scale_y_m
        # A dome's own slope changes no image.
        tilt = np.interp(np.hypot(dx, dy), profile.radius_m, np.abs(profile.tilt), right=0.0)
        tilt -= tilt.mean()
        sizes = float(np.linalg.norm(tilt) * np.linalg.norm(self._seen))
        return max(float(tilt @ self._seen) / max(sizes, 1e-12), 0.0) ** 2

    def search(self, ball_radius_m: float) -> tuple[Circle, float]:
        """Return the contact that explains most, and how much it does."""

        def missed(place: FloatArray) -> float:
            return -self.explained(_circle(place))

        scale, until = self._geometry.mean_scale_m, {"xatol": _FOUND_PX}
        starts = ([*self.start, share * ball_radius_m / scale] for share in _RADII)
        searches = [minimize(missed, s, method="Nelder-Mead", options=until) for s in starts]
        found = min(searches, key=lambda search: float(search.fun))
        return _circle(found.x), -float(found.fun)
