"""What the sensor's camera would see of a replayed trial: image, markers, intermediate states."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator

from reports.evidence.attempt import AttemptReading
from sim.fields.press_fields import TrialFields
from sim.fields.surface import IntermediateState, SurfaceState
from sim.optics.height.height_map import HeightMaps, height_maps
from sim.optics.markers.marker_printer import MarkerPrinter, seen_motion
from sim.optics.markers.printed_markers import PrintedMarkers, find_markers, follow_markers
from sim.optics.render.renderer import GREY_LEVEL, TactileRenderer
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor
from tacauchy_rig.app.replay.optics import OpticalCalibration, nominal_optics
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import RecordError, command_line
from tacauchy_rig.core.simulated import IMAGE_S, MarkerMotion, Replay
from tacauchy_rig.core.store.replay_files import ReplayFields

SAMPLES = 2
"""Of a pixel, along rows and along columns."""
WIDTH_PX = 160
"""Of the images and maps that are kept of intermediate states, at most."""
STATES = 8
"""Intermediate states of a trial, at most, its end among them."""


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
            remedy=f"`{command_line('recover', attempt.store.paths.root)}`, or repeat the trial",
        )
    markers = find_markers(unloaded)
    maps = height_maps(fields.surface, geometry, pad=sensor.pad)
    image = image_of(fields.surface, sensor, optics, unloaded=unloaded)
    moved = None
    if markers is not None:
        loaded = None if attempt.images is None else attempt.images.real
        moved = marker_motion(attempt.record.index, markers, loaded, fields.surface, geometry)
    return RenderedTrial(
        kept=ReplayFields(
            fields=fields.arrays,
            height={"loaded_m": maps.loaded, "rest_m": maps.rest, "contact": maps.contact},
            image=image,
            # Surfaces that were read again come without the other fields, which are on disk.
            surface_vtu=fields.surface_vtu if fields.shape else None,
        ),
        markers=moved,
    )


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
    found, image_s = {}, {}
    for attempt in attempts:
        index, started = attempt.record.index, time.perf_counter()
        found[index] = render_trial(attempt, sensor, fields[index], optics)
        image_s[index] = time.perf_counter() - started
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
        markers=tuple(trial.markers for trial in found.values() if trial.markers is not None),
    )
    states = intermediate_arrays(attempts, sensor, fields, optics)
    kept = {i: replace(each.kept, passed=states.get(i, {})) for i, each in found.items()}
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
        apart_median_px=_median(apart),
        tracking_error_px=float(np.median(tracks.error_px)) if len(tracks.error_px) else None,
    )


def _median(vectors: np.ndarray) -> float:
    return float(np.median(np.linalg.norm(vectors, axis=1))) if len(vectors) else 0.0


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
    maps = _Maps(sensor, optics)
    found = {}
    for attempt in attempts:
        trial = fields[attempt.record.index]
        if trial.intermediate and attempt.reference is not None:
            found[attempt.record.index] = _intermediate(attempt, trial, optics, maps)
    return found


def spread(states: Sequence[IntermediateState]) -> list[IntermediateState]:
    """Return at most ``STATES`` states, evenly spread, the last among them."""
    count = min(STATES, len(states))
    return [states[round((k + 1) * len(states) / count) - 1] for k in range(count)]


def _intermediate(
    attempt: AttemptReading,
    fields: TrialFields,
    optics: OpticalCalibration,
    maps: _Maps,
) -> dict[str, NDArray[Any]]:
    geometry, unloaded = optics.geometry, attempt.reference
    if unloaded is None:
        return {}
    markers = find_markers(unloaded)
    states = spread(fields.intermediate)
    seen = [maps.of(state) for state in states]
    top = states[0].surface.top
    printer = None if markers is None else MarkerPrinter(top, markers, geometry)
    renderer = TactileRenderer(
        unloaded if markers is None else markers.bare,
        seen[0].rest,
        optics.model,
        geometry,
        shadows=optics.shadows,
        blur_px=optics.blur_px,
    )
    images = []
    for state, each in zip(states, seen, strict=True):
        image = renderer.render(each.loaded)
        if printer is not None:
            image = printer.image_over(image, state.surface)
        images.append(_small(image))
    return {
        "force_n": np.array([state.force_n for state in states]),
        "depth_m": np.array([state.depth_m for state in states]),
        "image": np.stack(images),
        # Rounded, since digits that no picture shows would not pack.
        "dent_m": np.stack([_small(each.rest - each.loaded) for each in seen]).round(7),
        "pressure_pa": np.stack([maps.pressure_pa(state) for state in states]).round(-2),
    }


class _Maps:
    """Heights and pressures as the camera's pixels look; trials share their states."""

    def __init__(self, sensor: Sensor, optics: OpticalCalibration) -> None:
        self._pad, self._geometry = sensor.pad, optics.geometry
        self._heights: dict[int, HeightMaps] = {}
        self._pressures: dict[int, FloatArray] = {}

    def of(self, state: IntermediateState) -> HeightMaps:
        """Return the heights of a state."""
        if id(state) not in self._heights:
            found = height_maps(state.surface, self._geometry, pad=self._pad)
            self._heights[id(state)] = found
        return self._heights[id(state)]

    def pressure_pa(self, state: IntermediateState) -> FloatArray:
        """Return the pressure map of a state at the camera's pixels [Pa], averaged down."""
        if id(state) not in self._pressures:
            self._pressures[id(state)] = _small(self._pressed(state))
        return self._pressures[id(state)]

    def _pressed(self, state: IntermediateState) -> FloatArray:
        places, values = _touched(state)
        shape = (self._geometry.height, self._geometry.width)
        if len(places) == 0:
            return np.zeros(shape)
        drawn = LinearNDInterpolator(places, values, fill_value=0.0)(*self._geometry.pad_grid())
        return np.asarray(drawn, dtype=np.float64)


def _touched(state: IntermediateState) -> tuple[FloatArray, FloatArray]:
    """Return places and pressures of the nodes in contact and of those around it."""
    places = state.surface.positions[:, :2]
    touched = places[state.pressure_pa > 0.0]
    if len(touched) == 0:
        return touched, state.pressure_pa[:0]
    low, high = touched.min(axis=0), touched.max(axis=0)
    margin = 0.3 * (high - low).max()
    near = np.all((places > low - margin) & (places < high + margin), axis=1)
    return places[near], state.pressure_pa[near]


def _small(image: NDArray[Any]) -> NDArray[Any]:
    """Return an image or a map averaged down to at most ``WIDTH_PX`` columns."""
    height, width = image.shape[:2]
    if width <= WIDTH_PX:
        return image
    size = (WIDTH_PX, max(1, round(height * WIDTH_PX / width)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
