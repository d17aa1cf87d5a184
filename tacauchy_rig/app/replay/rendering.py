"""What the sensor's camera would see of a replayed trial: image, markers, intermediate states."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator

from reports.evidence.frames_and_curves import AttemptReading
from reports.figures.trial_axis import spread
from sim.fields.saved_press import IntermediateState, SurfaceState, TrialFields
from sim.optics.height.height_map import HeightMaps, height_maps
from sim.optics.markers.marker_tracking import PrintedMarkers, find_markers, follow_markers
from sim.optics.markers.simulated_markers import MarkerPrinter, seen_motion
from sim.optics.render.renderer import TactileRenderer
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor
from tacauchy_rig.app.replay.chosen_optics import OpticalCalibration, grey_frame, nominal_optics
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import RecordError, command_line
from tacauchy_rig.core.simulated import IMAGE_S, MarkerMotion, Replay
from tacauchy_rig.core.store.run_store import ReplayFields

SAMPLES = 2
"""Of a pixel, along rows and along columns."""
WIDTH_PX = 160
"""Of the images and maps that are kept of intermediate states, at most."""
STATES = 8
"""Intermediate states of a trial, at most, its end among them."""


def render_trial(
    attempt: AttemptReading, sensor: Sensor, fields: TrialFields, optics: OpticalCalibration
) -> tuple[ReplayFields, MarkerMotion | None]:
    """Render a replayed trial over its own no-contact frame.

    Returns:
        Its arrays and image, and how its markers moved; None where the unit shows none.
    """
    geometry, unloaded = optics.geometry, attempt.reference
    if unloaded is None:
        raise RecordError(
            f"{attempt.recording.path}: trial {attempt.record.index} has no "
            "readable no-contact frame",
            remedy=f"`{command_line('recover', attempt.store.paths.root)}`, or repeat the trial",
        )
    markers, moved = find_markers(unloaded), None
    if markers is not None:
        loaded = None if attempt.images is None else attempt.images.real
        moved = marker_motion(attempt.record.index, markers, loaded, fields.surface, geometry)
    kept = ReplayFields(
        fields=fields.arrays,
        height=height_arrays(height_maps(fields.surface, geometry, pad=sensor.pad)),
        image=image_of(fields.surface, sensor, optics, unloaded=unloaded),
        # Surfaces that were read again come without the other fields, which are on disk.
        surface_vtu=fields.surface_vtu if fields.shape else None,
    )
    return kept, moved


def height_arrays(maps: HeightMaps) -> dict[str, NDArray[Any]]:
    """Return height maps as a replay keeps them."""
    return {"loaded_m": maps.loaded, "rest_m": maps.rest, "contact": maps.contact}


def rendered(
    attempts: Sequence[AttemptReading],
    sensor: Sensor,
    replay: Replay,
    fields: Mapping[int, TrialFields],
    optics: OpticalCalibration,
) -> tuple[Replay, dict[int, ReplayFields]]:
    """Render what was pressed by one indenter at one place, each trial over its no-contact frame.

    Returns:
        The replay with what the camera sees of it, and arrays and images by trial.

    Raises:
        RecordError: A recording has no readable no-contact frame.
        ConfigError: The frame's markers are not where the sensor's file says.
    """
    kept, markers, image_s = {}, [], {}
    for attempt in attempts:
        index, started = attempt.record.index, time.perf_counter()
        kept[index], moved = render_trial(attempt, sensor, fields[index], optics)
        image_s[index] = time.perf_counter() - started
        if moved is not None:
            markers.append(moved)
    trials = tuple(
        replace(trial, wall_s={**trial.wall_s, IMAGE_S: image_s[trial.index]})
        if trial.index in image_s
        else trial
        for trial in replay.trials
    )
    uncertainty, source = sensor.young_uncertainty()
    model = replace(
        replay.model,
        young_uncertainty_relative=uncertainty,
        young_source=source,
        optics=dict(optics.model.provenance),
        scale_x_m_px=optics.geometry.scale_x_m,
        image_centre_m=optics.geometry.centre_from_middle_m,
        scale_y_m_px=optics.geometry.scale_y_m,
        markers=tuple(markers),
    )
    for index, arrays in intermediate_arrays(attempts, sensor, fields, optics).items():
        kept[index] = replace(kept[index], passed=arrays)
    return replace(replay, trials=trials, model=model), kept


def image_of(
    surface: SurfaceState, sensor: Sensor, optics: OpticalCalibration, *, unloaded: ImageArray
) -> ImageArray:
    """Return the image of a pressed surface.

    Args:
        unloaded: No-contact frame; the markers that it shows go with the gel.
    """
    fine = height_maps(surface, optics.geometry.refined(SAMPLES), pad=sensor.pad)
    markers = find_markers(unloaded)
    if markers is None:
        return drawn_image(fine.rest, fine.loaded, optics, unloaded=unloaded)
    bare = drawn_image(fine.rest, fine.loaded, optics, unloaded=markers.bare)
    return MarkerPrinter(surface.top, markers, optics.geometry).image_over(bare, surface)


def drawn_image(
    rest_m: FloatArray, loaded_m: FloatArray, optics: OpticalCalibration, *, unloaded: ImageArray
) -> ImageArray:
    """Return the image of heights [m], ``SAMPLES`` along each side of a pixel.

    Args:
        rest_m: Of the unloaded surface.
        loaded_m: Of the pressed one.
        unloaded: No-contact frame without markers.
    """
    return _renderer(rest_m, optics, unloaded, samples=SAMPLES).render(loaded_m)


def _renderer(
    rest_m: FloatArray, optics: OpticalCalibration, unloaded: ImageArray, *, samples: int = 1
) -> TactileRenderer:
    return TactileRenderer(
        unloaded,
        rest_m,
        optics.model,
        optics.geometry,
        shadows=optics.shadows,
        samples=samples,
        blur_px=optics.blur_px,
    )


def replay_images(sensor: Sensor) -> Callable[[SurfaceState], ImageArray]:
    """Return what makes images without a recording: nominal optics over an evenly grey frame."""
    optics = nominal_optics(sensor)
    return lambda surface: image_of(surface, sensor, optics, unloaded=grey_frame(optics))


def marker_motion(
    trial: int,
    markers: PrintedMarkers,
    loaded: ImageArray | None,
    surface: SurfaceState,
    geometry: CameraGeometry,
) -> MarkerMotion:
    """Compare the markers' way into a recorded frame with that of the simulated surface.

    Args:
        loaded: Frame of the dwell, RGB; None where none could be read.
    """
    drawn = len(markers.centres_px)
    if loaded is None:
        return MarkerMotion(trial=trial, drawn=drawn)
    tracks = follow_markers(markers, loaded)
    simulated = seen_motion(surface, geometry.to_pad(tracks.rest_px), geometry)
    apart, scale = tracks.motion_px - simulated, (geometry.scale_x_m, geometry.scale_y_m)
    return MarkerMotion(
        trial=trial,
        drawn=drawn,
        tracked=len(tracks.rest_px),
        lost=tracks.lost,
        recorded_rms_m=_rms(tracks.motion_px * scale),
        recorded_largest_m=_largest(tracks.motion_px * scale),
        simulated_rms_m=_rms(simulated * scale),
        simulated_largest_m=_largest(simulated * scale),
        apart_rms_m=_rms(apart * scale),
        apart_largest_m=_largest(apart * scale),
        apart_median_px=float(np.median(np.linalg.norm(apart, axis=1))) if len(apart) else 0.0,
        tracking_error_px=float(np.median(tracks.error_px)) if len(tracks.error_px) else None,
    )


def _rms(vectors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1)))) if len(vectors) else 0.0


def _largest(vectors: np.ndarray) -> float:
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))


def intermediate_arrays(
    attempts: Sequence[AttemptReading],
    sensor: Sensor,
    fields: Mapping[int, TrialFields],
    optics: OpticalCalibration,
) -> dict[int, dict[str, NDArray[Any]]]:
    """Return what the camera would see of a few intermediate states of each trial.

    The trials are of one indenter at one place.

    Returns:
        By trial ``force_n`` and ``depth_m``, shape [n], ``image``, RGB, uint8, shape
        [n, height, width, 3], ``dent_m`` and ``pressure_pa``, shape [n, height, width].
    """
    seen: dict[int, tuple[HeightMaps, FloatArray]] = {}

    def look(state: IntermediateState) -> tuple[HeightMaps, FloatArray]:
        if id(state) not in seen:  # trials share their states
            heights = height_maps(state.surface, optics.geometry, pad=sensor.pad)
            seen[id(state)] = heights, _small(_pressure_pa(state, optics.geometry))
        return seen[id(state)]

    found = {}
    for attempt in attempts:
        index, unloaded = attempt.record.index, attempt.reference
        states = spread(list(fields[index].intermediate), STATES)
        if states and unloaded is not None:
            maps = [look(state) for state in states]
            found[index] = {
                "force_n": np.array([state.force_n for state in states]),
                "depth_m": np.array([state.depth_m for state in states]),
                "image": _images(states, [heights for heights, _ in maps], unloaded, optics),
                # Rounded, since digits that no picture shows would not pack.
                "dent_m": np.stack([_small(each.rest - each.loaded) for each, _ in maps]).round(7),
                "pressure_pa": np.stack([pressure_pa for _, pressure_pa in maps]).round(-2),
            }
    return found


def _images(
    states: Sequence[IntermediateState],
    heights: Sequence[HeightMaps],
    unloaded: ImageArray,
    optics: OpticalCalibration,
) -> ImageArray:
    """Return small images of the states of a trial, shape [state_count, height, width, 3]."""
    markers, printer = find_markers(unloaded), None
    if markers is not None:
        printer = MarkerPrinter(states[0].surface.top, markers, optics.geometry)
        unloaded = markers.bare
    renderer, images = _renderer(heights[0].rest, optics, unloaded), []
    for state, each in zip(states, heights, strict=True):
        image = renderer.render(each.loaded)
        images.append(_small(printer.image_over(image, state.surface) if printer else image))
    return np.stack(images)


def _pressure_pa(state: IntermediateState, geometry: CameraGeometry) -> FloatArray:
    """Return the pressure map of a state at the camera's pixels [Pa], by nodes at the contact."""
    places = state.surface.positions[:, :2]
    touched = places[state.pressure_pa > 0.0]
    if len(touched) == 0:
        return np.zeros((geometry.height, geometry.width))
    low, high = touched.min(axis=0), touched.max(axis=0)
    margin = 0.3 * (high - low).max()
    near = np.all((places > low - margin) & (places < high + margin), axis=1)
    drawn = LinearNDInterpolator(places[near], state.pressure_pa[near], fill_value=0.0)
    return np.asarray(drawn(*geometry.pad_grid()), dtype=np.float64)


def _small(image: NDArray[Any]) -> NDArray[Any]:
    """Return an image or a map averaged down to at most ``WIDTH_PX`` columns."""
    height, width = image.shape[:2]
    if width <= WIDTH_PX:
        return image
    size = (WIDTH_PX, max(1, round(height * WIDTH_PX / width)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
