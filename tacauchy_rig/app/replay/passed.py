"""What the camera would see on the way to each force: small pictures and maps of a few states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator

from reports.evidence.attempt import AttemptReading
from sim.fields.press_fields import TrialFields
from sim.fields.surface import PassedState
from sim.optics.height.height_map import HeightMaps, height_maps
from sim.optics.markers.material_points import surface_displacement
from sim.optics.markers.printed_markers import printed_markers
from sim.optics.render.renderer import TactileRenderer
from sim.sensor.sensor import Sensor
from tacauchy_rig.app.replay.optics import OpticalCalibration
from tacauchy_rig.core.arrays import FloatArray

WIDTH_PX = 160
"""Of what is kept, at most."""
STATES = 8
"""Of a trial, at most, its end among them."""


def passed_arrays(
    attempts: Sequence[AttemptReading],
    sensor: Sensor,
    fields: Mapping[int, TrialFields],
    optics: OpticalCalibration,
) -> dict[int, dict[str, NDArray[Any]]]:
    """Return for each trial of one indenter at one place what is seen on its way.

    Returns:
        By trial ``force_n`` and ``depth_m``, shape [n], ``image``, RGB, uint8, shape
        [n, height, width, 3], ``dent_m`` and ``pressure_pa``, shape [n, height, width].
    """
    maps = _Maps(sensor, optics)
    return {
        attempt.record.index: _of_trial(attempt, sensor, fields[attempt.record.index], optics, maps)
        for attempt in attempts
        if fields[attempt.record.index].passed and attempt.reference is not None
    }


def spread(states: Sequence[PassedState]) -> list[PassedState]:
    """Return at most ``STATES`` of them, evenly spread, the last among them."""
    count = min(STATES, len(states))
    return [states[round((k + 1) * len(states) / count) - 1] for k in range(count)]


def _of_trial(
    attempt: AttemptReading,
    sensor: Sensor,
    fields: TrialFields,
    optics: OpticalCalibration,
    maps: _Maps,
) -> dict[str, NDArray[Any]]:
    geometry, unloaded = optics.geometry, attempt.reference
    if unloaded is None:
        return {}
    printed = printed_markers(unloaded, sensor.markers, geometry)
    states = spread(fields.passed)
    seen = [maps.of(state) for state in states]
    renderer = TactileRenderer(
        unloaded if printed is None else printed.bare,
        seen[0].rest,
        optics.model,
        geometry,
        shadows=optics.shadows,
        blur_px=optics.blur_px,
    )
    images = []
    for state, each in zip(states, seen, strict=True):
        image = renderer.render(each.loaded)
        if printed is not None:
            moved = surface_displacement(state.surface, printed.places_m)[:, :2]
            image = printed.over(image, moved, geometry)
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
    """Heights and pressures as the camera's pixels look; trials share what they pass."""

    def __init__(self, sensor: Sensor, optics: OpticalCalibration) -> None:
        self._pad, self._geometry = sensor.pad, optics.geometry
        self._heights: dict[int, HeightMaps] = {}
        self._pressures: dict[int, FloatArray] = {}

    def of(self, state: PassedState) -> HeightMaps:
        """Return the heights of a state."""
        if id(state) not in self._heights:
            found = height_maps(state.surface, self._geometry, pad=self._pad)
            self._heights[id(state)] = found
        return self._heights[id(state)]

    def pressure_pa(self, state: PassedState) -> FloatArray:
        """Return what presses on the gel that lies where a pixel looks [Pa], made small."""
        if id(state) not in self._pressures:
            self._pressures[id(state)] = _small(self._pressed(state))
        return self._pressures[id(state)]

    def _pressed(self, state: PassedState) -> FloatArray:
        places, values = _touched(state)
        shape = (self._geometry.height, self._geometry.width)
        if len(places) == 0:
            return np.zeros(shape)
        drawn = LinearNDInterpolator(places, values, fill_value=0.0)(*self._geometry.pad_grid())
        return np.asarray(drawn, dtype=np.float64)


def _touched(state: PassedState) -> tuple[FloatArray, FloatArray]:
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
