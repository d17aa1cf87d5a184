"""A replayed trial as the sensor's camera would see it, and how its markers moved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from reports.evidence.attempt import AttemptReading
from sim.fields.press_fields import TrialFields
from sim.fields.surface import SurfaceState
from sim.optics.height.height_map import height_maps
from sim.optics.markers.material_points import surface_displacement
from sim.optics.markers.printed_markers import PrintedMarkers, printed_markers
from sim.optics.markers.tracking import track_markers
from sim.optics.render.renderer import GREY_LEVEL, TactileRenderer
from sim.sensor.sensor import Sensor
from tacauchy_rig.app.replay.optics import OpticalCalibration, nominal_optics
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.simulated import MarkerMotion
from tacauchy_rig.core.store.replay_files import ReplayFields

SAMPLES = 2
"""Of a pixel, along rows and along columns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderedTrial:
    """Arrays and image of a trial; how its markers moved, None where the unit shows none."""

    kept: ReplayFields
    markers: MarkerMotion | None


def render_trial(
    attempt: AttemptReading,
    sensor: Sensor,
    fields: TrialFields,
    optics: OpticalCalibration,
) -> RenderedTrial:
    """Render a replayed trial over its own no-contact frame.

    Raises:
        RecordError: The recording has no readable no-contact frame.
        ConfigError: The frame's markers are not where the sensor's file says.
    """
    geometry, unloaded = optics.geometry, attempt.reference
    if unloaded is None:
        raise RecordError(
            f"{attempt.recording.path}: trial {attempt.record.index} has no "
            "readable no-contact frame",
            remedy=f"`tacauchy-rig recover {attempt.store.paths.root}`, or repeat the trial",
        )
    printed = printed_markers(unloaded, sensor.markers, geometry)
    bare = unloaded if printed is None else printed.bare
    maps = height_maps(fields.surface, geometry, pad=sensor.pad)
    image = image_of(fields.surface, sensor, optics, unloaded=bare)
    moved = None
    if printed is not None and sensor.markers is not None:
        found = surface_displacement(fields.surface, printed.places_m)[:, :2]
        image = printed.over(image, found, geometry)
        moved = _marker_motion(attempt, printed, fields, optics, sensor.markers.radius_m)
    return RenderedTrial(
        kept=ReplayFields(
            fields=fields.arrays,
            height={"loaded_m": maps.loaded, "rest_m": maps.rest, "contact": maps.contact},
            image=image,
            surface_vtu=fields.surface_vtu,
        ),
        markers=moved,
    )


def image_of(
    surface: SurfaceState, sensor: Sensor, optics: OpticalCalibration, *, unloaded: ImageArray
) -> ImageArray:
    """Return the image of a pressed surface.

    Args:
        unloaded: No-contact frame without markers.
    """
    fine = height_maps(surface, optics.geometry.refined(SAMPLES), pad=sensor.pad)
    return drawn_image(fine.rest, fine.loaded, optics, unloaded=unloaded)


def drawn_image(
    rest_m: FloatArray, loaded_m: FloatArray, optics: OpticalCalibration, *, unloaded: ImageArray
) -> ImageArray:
    """Return the image of heights [m], ``SAMPLES`` along each side of a pixel.

    Args:
        rest_m: Of the unloaded surface.
        loaded_m: Of the pressed one.
        optics: How it is seen.
        unloaded: No-contact frame without markers.
    """
    renderer = TactileRenderer(
        unloaded,
        rest_m,
        optics.model,
        optics.geometry,
        shadows=optics.shadows,
        samples=SAMPLES,
        blur_px=optics.blur_px,
    )
    return renderer.render(loaded_m)


def replay_images(sensor: Sensor) -> Callable[[SurfaceState], ImageArray]:
    """Return what makes images without a recording: nominal optics over an evenly grey frame."""
    optics = nominal_optics(sensor)
    shape = (optics.geometry.height, optics.geometry.width, 3)
    even = np.full(shape, GREY_LEVEL, dtype=np.uint8)
    return lambda surface: image_of(surface, sensor, optics, unloaded=even)


def _marker_motion(
    attempt: AttemptReading,
    printed: PrintedMarkers,
    fields: TrialFields,
    optics: OpticalCalibration,
    radius_m: float,
) -> MarkerMotion:
    """Compare the markers' way in the recorded frames with that of the simulated surface."""
    trial, drawn = attempt.record.index, len(printed.places_m)
    if attempt.images is None:
        return MarkerMotion(trial=trial, drawn=drawn)
    tracks = track_markers(
        attempt.images.reference, attempt.images.real, optics.geometry, radius_m=radius_m
    )
    simulated = surface_displacement(fields.surface, tracks.places_m)[:, :2]
    return MarkerMotion(
        trial=trial,
        drawn=drawn,
        tracked=len(tracks.places_m),
        lost=tracks.lost,
        recorded_rms_m=_rms(tracks.displacement_m),
        recorded_largest_m=_largest(tracks.displacement_m),
        simulated_rms_m=_rms(simulated),
        simulated_largest_m=_largest(simulated),
        apart_rms_m=_rms(tracks.displacement_m - simulated),
        apart_largest_m=_largest(tracks.displacement_m - simulated),
    )


def _rms(vectors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1)))) if len(vectors) else 0.0


def _largest(vectors: np.ndarray) -> float:
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))
