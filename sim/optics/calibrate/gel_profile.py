"""The gel around a pressed ball, as the simulator presses it: its surface, and how markers move."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.optimize import minimize_scalar

from sim.effects.effect_choice import plan_effects
from sim.effects.presets import RESOLUTIONS, build_model, mesh_for
from sim.effects.press_with_effects import path_for
from sim.fields.saved_press import SurfaceState, surface_state
from sim.optics.calibrate.ball_press import Circle
from sim.optics.height.height_map import HeightMaps, height_maps
from sim.optics.markers.marker_tracking import MarkerTracks
from sim.scene.indenter import Sphere
from sim.scene.pad import Pad
from sim.scene.scene import Preset, Target
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor
from tacauchy_rig.core.arrays import BoolArray, FloatArray
from tacauchy_rig.core.errors import ConfigError

_PIXEL_M = 2e-5
_PIXELS = 640  # as far as the gel moves beside a deep press
# Slopes bend at the contact's edge, which lies elsewhere at every depth. With the presets' edges
# (0.25 and 0.17 of the contact's radius) the radius comes out up to a tenth off and the tilt by up
# to 0.12, with a contact distance of 5 um the gel is lifted by as much there; with these by 0.02.
_EDGE_SHARE = 0.06
_GROWTH = 1.5
_SECTORS = 16
_CONTACT_DISTANCE_M = 1e-6
_TOUCHING_M = 1.2e-6
# Of the depth: gaps beside the ball which tell where the contact ends; and how many are needed.
_GAPS, _FEWEST_GAPS = (0.003, 0.1), 3
_STEP_M = 5e-5  # over which the slope of an unloaded pad is taken
_TOUCHING_ROUNDS = 4
DEPTHS_M = (2e-4, 3.5e-4, 5e-4, 7e-4, 9e-4, 1.2e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class RadialProfile:
    """Axisymmetric gel surface."""

    radius_m: FloatArray  # ascending distances from the ball's axis [m], shape [sample_count]
    tilt: FloatArray  # sine of the surface's angle, positive where it rises outwards, same shape
    indentation_m: FloatArray  # unloaded minus loaded height [m], same shape
    outward_m: FloatArray  # by how much the gel now there has moved away from the axis [m]

    def outward(self, radius_m: FloatArray) -> FloatArray:
        """Return how far the gel at distances from the axis has moved away from it [m].

        Beyond the profile motion in a layer decays like that of displaced volume.
        """
        farther = np.minimum(self.radius_m[-1] / np.maximum(radius_m, 1e-12), 1.0)
        return np.asarray(np.interp(radius_m, self.radius_m, self.outward_m) * farther)

    def curvature(self, radius_m: FloatArray, *, width_m: float) -> FloatArray:
        """Return the divergence of the tilt [1/m] at distances from the axis, over a width [m].

        It is by the flux of the tilt, so that a sharp bend counts whole however narrow it is.
        """
        outer = radius_m + 0.5 * width_m
        inner = np.maximum(radius_m - 0.5 * width_m, 0.0)
        flux = [r * np.interp(r, self.radius_m, self.tilt, right=0.0) for r in (outer, inner)]
        return np.asarray(2.0 * (flux[0] - flux[1]) / (outer**2 - inner**2))


GelProfile = Callable[[float], RadialProfile]
"""The gel around a ball of one size on one gel, by the radius of its contact [m]."""


class PressedProfiles:
    """Profiles of simulated presses by contact radius [m], interpolated in it.

    Between and beyond them profiles are scaled as a ball of fixed size wants it: lengths along the
    gel with the contact's radius a, tilt with a, and displacements with a^2.
    """

    def __init__(self, presses: Sequence[tuple[float, RadialProfile]]) -> None:
        if not presses or min(radius for radius, _ in presses) <= 0.0:
            raise ConfigError(
                f"{len(presses)} simulated presses give no gel profile",
                remedy="give at least one press whose contact has an area",
            )
        ordered = sorted(presses, key=lambda press: press[0])
        self._radii = np.array([radius for radius, _ in ordered])
        self._between = [*map(_side_by_side, ordered, [*ordered[1:], ordered[-1]])]

    def __call__(self, contact_radius_m: float) -> RadialProfile:
        """Return the gel's surface where the contact has this radius [m]."""
        place = float(np.interp(contact_radius_m, self._radii, np.arange(len(self._radii))))
        share = place - int(place)
        radius, lower, upper = self._between[int(place)]
        scales = contact_radius_m ** np.array([1.0, 2.0, 2.0])
        tilt, depth, outward = scales[:, None] * ((1.0 - share) * lower + share * upper)
        radius_m = contact_radius_m * radius
        return RadialProfile(radius_m=radius_m, tilt=tilt, indentation_m=depth, outward_m=outward)


def _side_by_side(*presses: tuple[float, RadialProfile]) -> list[FloatArray]:
    """Return distances in radii of the contact, and there the profiles by its radius, [3, n]."""
    reach = max(profile.radius_m[-1] / own for own, profile in presses)
    radius = np.linspace(0.0, reach, max(len(profile.radius_m) for _, profile in presses))
    found = [radius]
    for own, profile in presses:
        at, still = radius * own, (profile.tilt, profile.indentation_m)
        values = [np.interp(at, profile.radius_m, each, right=0.0) for each in still]
        scales = own ** np.array([1.0, 2.0, 2.0])
        found.append(np.stack([*values, profile.outward(at)]) / scales[:, None])
    return found


def radial_profile(
    maps: HeightMaps, surface: SurfaceState, geometry: CameraGeometry, *, ball_radius_m: float
) -> tuple[float, RadialProfile]:
    """Return a centred press's contact radius [m], and the mean over the azimuth."""
    x, y = geometry.pad_grid()
    r = np.hypot(x, y)
    step = max(geometry.scale_x_m, geometry.scale_y_m)
    half_width = min(float(np.abs(x).max()), float(np.abs(y).max()))
    ring = np.rint(r / step).astype(np.int64)
    rings = np.unique(ring[ring <= int(half_width / step)])
    radius, rest, loaded = (ndimage.mean(each, ring, rings) for each in (r, maps.rest, maps.loaded))
    depth = rest - loaded
    slope = -np.gradient(depth, radius)
    tilt, outward = slope / np.hypot(1.0, slope), _moved_outward(surface, radius)
    profile = RadialProfile(radius_m=radius, tilt=tilt, indentation_m=depth, outward_m=outward)
    area = float(maps.contact.sum()) * geometry.scale_x_m * geometry.scale_y_m
    touching_m = float(np.sqrt(area / np.pi))
    return _contact_radius(radius, loaded, float(depth[0]), ball_radius_m, touching_m), profile


def _contact_radius(
    radius_m: FloatArray,
    height_m: FloatArray,
    depth_m: float,
    ball_radius_m: float,
    touching_m: float,
) -> float:
    """Return where gel of these heights leaves a ball [m]: the gap beside it grows as Hertz's.

    The radius of the area that touches depends on the mesh by several per cent; it is taken where
    the ball is deeper than its radius, or the contact too wide to see gaps beside it. Gap beside a
    contact: Johnson, Contact Mechanics (1985), Eq. 3.42a.
    """
    below = np.minimum(radius_m, ball_radius_m)
    gap_m = height_m[0] + ball_radius_m - np.sqrt(ball_radius_m**2 - below**2) - height_m
    near = (gap_m > _GAPS[0] * depth_m) & (gap_m < _GAPS[1] * depth_m) & (below < ball_radius_m)
    if depth_m > ball_radius_m or np.count_nonzero(near) < _FEWEST_GAPS:
        return touching_m
    at_m, seen = radius_m[near], gap_m[near] ** (2.0 / 3.0)

    def misfit(edge_m: float) -> float:
        away = at_m / edge_m
        gap = np.sqrt(away**2 - 1.0) + (away**2 - 2.0) * np.arccos(1.0 / away)
        shape = gap ** (2.0 / 3.0)
        return float(np.sum((seen - shape * (shape @ seen) / (shape @ shape)) ** 2))

    bounds = 0.7 * at_m[0], 0.9999 * at_m[0]
    return float(minimize_scalar(misfit, bounds=bounds, method="bounded").x)


def _moved_outward(surface: SurfaceState, radius_m: FloatArray) -> FloatArray:
    """Return how far the gel at distances from the axis has moved away from it [m], [n]."""
    rest, now = (np.hypot(*p[:, :2].T) for p in (surface.positions_rest, surface.positions))
    edges = np.append(0.0, radius_m[1:] + 0.5 * np.diff(radius_m))
    ring = np.searchsorted(edges, now)
    rings = np.unique(ring[ring < len(edges)])
    at, moved = (ndimage.mean(each, ring, rings) for each in (now, now - rest))
    return np.asarray(np.interp(radius_m, np.append(0.0, at), np.append(0.0, moved)))


def ball_profiles(
    sensor: Sensor, *, ball_diameter_m: float, preset: Preset, on_press: Callable[[int], None]
) -> PressedProfiles:
    """Press a ball into the middle of a sensor's pad and keep the gel's profile at each depth.

    Raises:
        ConvergenceError: A depth finds no equilibrium.
    """
    ball, target = Sphere(diameter_m=ball_diameter_m), Target(depth_m=DEPTHS_M[-1])
    scene = sensor.scene(ball, target, preset=preset, barrier_m=_CONTACT_DISTANCE_M)
    # Finer than the preset: of the ball's small contact every edge is looked at.
    usual = RESOLUTIONS.get(scene.preset, RESOLUTIONS[Preset.FAST])
    fine = replace(usual, smooth_share=_EDGE_SHARE, growth=_GROWTH, sector_count=_SECTORS)
    model = build_model(scene, mesh=mesh_for(scene, resolution=fine))
    path = path_for(scene, plan_effects(scene), model=model)
    path.step_max_m = DEPTHS_M[-1]  # depths lie so near that each is one step
    geometry = CameraGeometry.centred(_PIXELS, _PIXELS, scale_x_m=_PIXEL_M, scale_y_m=_PIXEL_M)
    found = []
    for depth in DEPTHS_M:
        # The profile is a mean over all directions: circles drawn round would shift it, held-out
        # presses are then predicted 10 % worse.
        surface = replace(surface_state(path, path.advance(depth)), mesh_axis_m=None)
        maps = height_maps(surface, geometry, contact_gap_m=_TOUCHING_M, pad=sensor.pad)
        found.append(radial_profile(maps, surface, geometry, ball_radius_m=0.5 * ball_diameter_m))
        on_press(len(found))
    return PressedProfiles(found)


def pad_slopes(pad: Pad, places_m: FloatArray) -> FloatArray:
    """Return dz/dx and dz/dy of the top at rest at x, y [m], [..., 2], zero beside the pad."""
    x, y, step = places_m[..., 0], places_m[..., 1], _STEP_M
    with np.errstate(invalid="ignore"):
        along = pad.height_at(x + step, y) - pad.height_at(x - step, y)
        across = pad.height_at(x, y + step) - pad.height_at(x, y - step)
    slopes = np.stack([along, across], axis=-1) / (2.0 * step)
    return np.where(np.isfinite(slopes), slopes, 0.0)


def rest_slopes(pad: Pad, geometry: CameraGeometry) -> FloatArray:
    """Return a pad's slope along columns and rows at every pixel, shape [2, height, width]."""
    slopes = pad_slopes(pad, np.stack(geometry.pad_grid(), axis=-1))
    directions = geometry.direction_matrix
    along = slopes @ (directions / np.linalg.norm(directions, axis=0))
    return np.ascontiguousarray(np.moveaxis(along, -1, 0))


def touching_places(axes_m: FloatArray, pad: Pad, *, ball_radius_m: float) -> FloatArray:
    """Return where balls with these axes touch a pad, x and y from its centre [m], shape [n, 2].

    Ball and gel have one slope there: on a dome that is beside the axis, towards the top.
    """
    places = axes_m
    for _ in range(_TOUCHING_ROUNDS):
        places = axes_m + ball_radius_m * pad_slopes(pad, places)
    return places


_ROUNDS = 12
_OUTLIER_PX = 0.5
_NEAR_RADII = 1.6
# Markers are trusted by how far the gel there is from what moves it: a model errs by a share of the
# motion, and far ones are many. The distance [radii] up to which all count alike, and the least.
_TRUSTED_RADII, _LEAST_TRUST = 1.5, 0.3
_OWN = 12  # unknowns of a press
_HELD = np.diag([0.0] * 8 + [0.1] + [0.3] * 3)  # those which few markers tell of
_STRETCHED_RADII = 3.0  # from where a stretch of the gel around a contact decays
_FARTHEST_M = 1.0  # of a camera whose rays are not taken to be parallel


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionModel:
    """What all presses of a sensor share."""

    per_distance: float = 0.0  # one over the pinhole's distance from the gel [1/m]; 0: orthographic
    slide: float = 1.0  # share of the simulated motion along the surface that is seen

    @property
    def factors(self) -> FloatArray:
        """Of the terms that all presses share, shape [2]."""
        return np.array([self.per_distance, self.slide])

    @property
    def distance_m(self) -> float:
        """Of the pinhole [m]; infinite for an orthographic view."""
        return 1.0 / self.per_distance if self.per_distance * _FARTHEST_M > 1.0 else np.inf


ORTHOGRAPHIC = MotionModel()


@dataclass(frozen=True, slots=True, kw_only=True)
class GelMotion:
    """What a press adds."""

    # By how much the ball took the gel along, columns and rows, then the drift of the image:
    # everywhere, and more at the right and bottom border, likewise; by how much the ball turned the
    # contact's edge; and stretched the gel there, in all directions, along columns more than rows,
    # and along one diagonal more than the other, shape [12]
    own_px: FloatArray
    error_px: FloatArray  # distance of each marker's fitted from its tracked motion, shape [n]
    under: BoolArray  # true for markers within 1.6 radii of the contact, shape [n]


def motion_terms(
    circle: Circle, profile: GelProfile, geometry: CameraGeometry, places_px: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what moves the gel seen at columns and rows [px], shape [n, 2], when it is pressed.

    Motion is linear in the factors of all presses, terms of shape [2, n, 2], and in the press's
    own unknowns, [12, n, 2]. A disc that sticks to an incompressible half-space takes the surface
    along as Mindlin (1949) and turns it as Reissner and Sagoci (1944) have it: inside as it moves
    itself, outside by s = 2/pi asin(a/r) and b = 2/pi a/r sqrt(1 - a^2/r^2) of that: by s + b/3
    in the direction of motion, s - b/3 beside, and turned by (r/a)^2 (s - b) of its turn.
    """
    scale = np.array([geometry.scale_x_m, geometry.scale_y_m])
    middle = 0.5 * np.array([geometry.width - 1.0, geometry.height - 1.0])
    arm = (places_px - (circle.x_px, circle.y_px)) * scale
    r = np.hypot(*arm.T)
    contact_m = circle.radius_px * geometry.mean_scale_m
    pressed = profile(contact_m)
    near = np.interp(r, pressed.radius_m, pressed.indentation_m, right=0.0)
    from_axis, radial = places_px - middle, arm / np.maximum(r, 1e-12)[:, None]
    inside = np.minimum(contact_m / np.maximum(r, 1e-12), 1.0)
    share = 2.0 / np.pi * np.arcsin(inside)
    beside = 2.0 / np.pi * inside * np.sqrt(1.0 - inside**2)
    slid = radial * pressed.outward(r)[:, None] / scale
    own = np.zeros((_OWN, len(r), 2))
    from_middle = np.column_stack([np.ones(len(r)), from_axis / middle])
    for axis in range(2):
        # With cos(2 theta) and sin(2 theta), and nu / (2 - nu) of 1/3 in place of nu.
        own[axis] = (beside / 3.0)[:, None] * 2.0 * radial[:, axis, None] * radial
        own[axis, :, axis] += share - beside / 3.0
        own[2 + axis : 8 : 2, :, axis] = from_middle.T
    twisted = r / contact_m * (share - beside)
    own[8] = twisted[:, None] * radial[:, ::-1] * (-1.0, 1.0)
    away = r / contact_m
    stretched = (away / (1.0 + (away / _STRETCHED_RADII) ** 3))[:, None] * radial
    own[9:] = stretched, stretched * (1.0, -1.0), stretched[:, ::-1]
    return np.stack([near[:, None] * from_axis, slid]), own


def fit_motions(
    tracks: Sequence[MarkerTracks],
    circles: Sequence[Circle],
    profile: GelProfile,
    geometry: CameraGeometry,
    model: MotionModel | None = None,
) -> tuple[MotionModel, list[GelMotion]]:
    """Fit each press's own motion, and what all share unless a model is given: least squares.

    Outliers are bounded. What a press owns is eliminated: of its equations, triangular by QR, the
    last ones are of the shared factors alone. Those are not below zero.
    """
    unmoved, held = np.zeros((_OWN, 3)), np.ones(_OWN)
    equations, under, near = [], [], []  # terms of a press's own, shared terms, and what is seen
    for track, circle in zip(tracks, circles, strict=True):
        places = track.rest_px + track.motion_px
        shared, own = motion_terms(circle, profile, geometry, places)
        seen = np.concatenate([own, shared, track.motion_px[None]]).reshape(_OWN + 3, -1).T
        equations.append(np.concatenate([seen, np.column_stack([_HELD, unmoved])]))
        away = np.maximum(circle.distance(*places.T) / circle.radius_px, 1e-9)
        under.append(away < _NEAR_RADII)
        trust = np.clip(_TRUSTED_RADII / away, _LEAST_TRUST, 1.0) ** 2
        near.append(np.append(np.repeat(trust, 2), held))
    weights = near
    found = (model or ORTHOGRAPHIC).factors
    for _ in range(_ROUNDS):
        weighted = (each * w[:, None] for each, w in zip(equations, weights, strict=True))
        triangles = [np.asarray(np.linalg.qr(each, mode="r")) for each in weighted]
        if model is None:
            last = np.concatenate([each[_OWN:, _OWN:] for each in triangles])
            found = np.maximum(np.linalg.lstsq(last[:, :2], last[:, 2], rcond=3e-5)[0], 0.0)
        left = [each[:_OWN, _OWN:] @ [*-found, 1.0] for each in triangles]
        pairs = zip(triangles, left, strict=True)
        values = [np.linalg.lstsq(each[:_OWN, :_OWN], rest, rcond=1e-9)[0] for each, rest in pairs]
        apart = [a @ [*-x, *-found, 1.0] for a, x in zip(equations, values, strict=True)]
        errors = [np.hypot(*each[:-_OWN].reshape(-1, 2).T) for each in apart]
        bounds = (np.repeat(1.0 / np.hypot(1.0, d / _OUTLIER_PX), 2) for d in errors)
        weights = [t * np.append(bound, held) for t, bound in zip(near, bounds, strict=True)]
    motions = [
        GelMotion(own_px=np.asarray(x, dtype=np.float64), error_px=d, under=close)
        for x, d, close in zip(values, errors, under, strict=True)
    ]
    return MotionModel(per_distance=float(found[0]), slide=float(found[1])), motions
