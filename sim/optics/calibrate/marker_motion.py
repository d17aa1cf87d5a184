"""How the markers of ball presses move in the image, and what of it the simulated gel explains.

Gel under the ball moves away from the image's middle, as it comes nearer to the camera; the
simulated surface moves outwards by itself; a ball that is not moved exactly along its axis takes
the gel under it along; and between two frames the whole image may drift. The first two are one
distance and one factor for all presses, the others are found of each press from its own markers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.optics.calibrate.ball_press import Circle
from sim.optics.calibrate.gel_profile import GelProfile
from sim.optics.markers.printed_markers import MarkerTracks
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import BoolArray, FloatArray

_ROUNDS = 12
_OUTLIER_PX = 0.5
_NEAR_RADII, _FAR_WEIGHT = 1.6, 0.3  # markers far from the contact are many, and tell little
_OWN = 8  # unknowns of a press
_FARTHEST_M = 1.0  # of a camera whose rays are not taken to be parallel


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionModel:
    """What all presses of a sensor share."""

    # One over the distance of the camera's pinhole from the gel [1/m]; 0 is an orthographic view
    per_distance: float = 0.0
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
    """What a press adds.

    Attributes:
        own_px: By how much the ball took the gel along, columns and rows, then the drift of the
            image: everywhere, and more at the right and bottom border, likewise, shape [8].
        error_px: Of each marker: distance of its fitted from its tracked motion, shape [n].
    """

    own_px: FloatArray
    error_px: FloatArray
    under: BoolArray  # true for markers within 1.6 radii of the contact, shape [n]


def motion_terms(
    circle: Circle, profile: GelProfile, geometry: CameraGeometry, places_px: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what moves the gel seen at columns and rows [px], shape [n, 2], when it is pressed.

    Motion is linear in the factors of all presses, terms of shape [2, n, 2], and in the press's
    own unknowns, [8, n, 2]. Outside its contact a disc that sticks takes the surface of an elastic
    half-space along by 2/pi asin(a/r) (Mindlin 1949).
    """
    scale = np.array([geometry.scale_x_m, geometry.scale_y_m])
    middle = 0.5 * np.array([geometry.width - 1.0, geometry.height - 1.0])
    arm = (places_px - (circle.x_px, circle.y_px)) * scale
    r = np.hypot(*arm.T)
    contact_m = circle.radius_px * geometry.mean_scale_m
    pressed = profile(contact_m)
    near = np.interp(r, pressed.radius_m, pressed.indentation_m, right=0.0)
    # Beyond the profile motion in a layer decays like that of displaced volume.
    farther = np.minimum(pressed.radius_m[-1] / np.maximum(r, 1e-12), 1.0)
    outward = np.interp(r, pressed.radius_m, pressed.outward_m) * farther
    away = places_px - middle
    share = 2.0 / np.pi * np.arcsin(np.minimum(contact_m / np.maximum(r, 1e-12), 1.0))
    slid = arm / np.maximum(r, 1e-12)[:, None] * outward[:, None] / scale
    own = np.zeros((_OWN, len(r), 2))
    from_middle = np.column_stack([np.ones(len(r)), away / middle])
    for axis in range(2):
        own[axis, :, axis] = share
        own[2 + axis :: 2, :, axis] = from_middle.T
    return np.stack([near[:, None] * away, slid]), own


def fit_motions(
    tracks: Sequence[MarkerTracks],
    circles: Sequence[Circle],
    profile: GelProfile,
    geometry: CameraGeometry,
    model: MotionModel | None = None,
) -> tuple[MotionModel, list[GelMotion]]:
    """Fit each press's own motion, and what all share unless a model is given.

    Least squares with outliers bounded; what a press owns is eliminated, so that any number of
    presses leaves two unknowns.
    """
    known = [track.motion_px.ravel() for track in tracks]
    shared, own, under = [], [], []
    for track, circle in zip(tracks, circles, strict=True):
        places = track.rest_px + track.motion_px
        terms = motion_terms(circle, profile, geometry, places)
        shared.append(terms[0].reshape(2, -1).T)
        own.append(terms[1].reshape(_OWN, -1).T)
        under.append(circle.distance(*places.T) < _NEAR_RADII * circle.radius_px)
    near = [np.repeat(np.where(each, 1.0, _FAR_WEIGHT), 2) for each in under]
    weights = near
    found = (model or ORTHOGRAPHIC).factors
    for _ in range(_ROUNDS):
        if model is None:
            found = _shared_factors(own, shared, known, weights)
        left = [y - b @ found for b, y in zip(shared, known, strict=True)]
        values = [
            np.linalg.lstsq(a * w[:, None], y * w, rcond=1e-9)[0]
            for a, y, w in zip(own, left, weights, strict=True)
        ]
        apart = [y - a @ x for a, y, x in zip(own, left, values, strict=True)]
        away = [np.hypot(*each.reshape(-1, 2).T) for each in apart]
        bounds = [np.repeat(1.0 / np.hypot(1.0, d / _OUTLIER_PX), 2) for d in away]
        weights = [each * bound for each, bound in zip(near, bounds, strict=True)]
    motions = [
        GelMotion(own_px=x, error_px=d, under=close)
        for x, d, close in zip(values, away, under, strict=True)
    ]
    return MotionModel(per_distance=float(found[0]), slide=float(found[1])), motions


def _shared_factors(
    own: Sequence[FloatArray],
    shared: Sequence[FloatArray],
    known: Sequence[FloatArray],
    weights: Sequence[FloatArray],
) -> FloatArray:
    """Return the factors of all presses, not below zero, with what each press owns eliminated."""
    normal, load = np.zeros((2, 2)), np.zeros(2)
    for a, b, y, w in zip(own, shared, known, weights, strict=True):
        basis = np.linalg.svd(a * w[:, None], full_matrices=False)[0]
        terms, rest = (each - basis @ (basis.T @ each) for each in (b * w[:, None], y * w))
        normal += terms.T @ terms
        load += terms.T @ rest
    return np.asarray(np.maximum(np.linalg.lstsq(normal, load, rcond=1e-9)[0], 0.0))
