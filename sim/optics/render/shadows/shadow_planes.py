"""Shadows in many images of one camera: what of each lamp is hidden, sample by sample."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.optics.height.tilt import Float32Array
from sim.optics.render.nominal import Lamp
from sim.optics.render.pixel_kernel import LANES
from sim.optics.render.pixel_planes import (
    CPU,
    PixelLayout,
    Planes,
    SampledBand,
    blocks_of,
    shifted_blocks,
)
from sim.optics.render.shadows.horizon import Sweep, sweep_places, sweep_towards
from sim.optics.render.shadows.shadow import ShadowCaster, rise_in_a_step_m
from sim.optics.render.shadows.shadow_kernel import Rays, darken_blocks, hide_pixels
from sim.optics.render.two_threads import Task


class ShadowPlanes:
    """Lamps that the dent hides, for the samples of an image.

    Args:
        shadows: The lamps.
        layout: Of the image.
        rest_height: Of the unloaded gel's samples [m], shape [height, width].
    """

    def __init__(
        self, shadows: ShadowCaster, layout: PixelLayout, rest_height: NDArray[np.floating]
    ) -> None:
        self._rest_height = rest_height
        fine = layout.geometry.refined(layout.samples)
        sweeps = [sweep_towards(lamp.azimuth_rad, rest_height.shape) for lamp in shadows.lamps]
        self._dents = {
            turned: _Dent([sweep for sweep in sweeps if sweep.along_columns == turned])
            for turned in {sweep.along_columns for sweep in sweeps}
        }
        self._lamps = [
            _HiddenLamp(
                lamp,
                sweep,
                rise_in_a_step_m(lamp, sweep, fine),
                shadows.softness_m,
                layout,
                self._dents[sweep.along_columns],
            )
            for lamp, sweep in zip(shadows.lamps, sweeps, strict=True)
        ]

    def follow(self, height: NDArray[np.floating]) -> list[Task]:
        """Return what finds what is hidden of each lamp by the loaded gel's heights [m]."""
        dent = np.subtract(self._rest_height, height, dtype=np.float32, casting="same_kind")
        for turned, kept in self._dents.items():
            kept.values[...] = cv2.transpose(dent) if turned else dent
        return [lamp.hide for lamp in self._lamps]

    def over(self, band: SampledBand, change: Planes) -> list[Task]:
        """Return what takes light from the change of colour of a band that was sampled."""
        return [lamp.over(band, change) for lamp in self._lamps]


class _Dent:
    """Unloaded minus loaded height [m] in rows across some sweeps, with room for their rays.

    Attributes:
        values: Shape [step_count, across].
        room: Values before them in each row.
        pitch: Blocks of a row.
        shifted: Blocks at each shift up to one block.
    """

    def __init__(self, sweeps: list[Sweep]) -> None:
        margin = max(sweep.margin for sweep in sweeps)
        steps, across = sweeps[0].step_count, sweeps[0].across
        self.room = _blocks(margin + 2) * LANES
        self.pitch = self.room // LANES + _blocks(across + margin) + 3
        self._memory = np.zeros((steps + 1) * self.pitch * LANES, dtype=np.float32)
        rows = self._memory.reshape(steps + 1, -1)
        self.values: Float32Array = rows[:steps, self.room : self.room + across]
        self.shifted = shifted_blocks(self._memory[: -2 * LANES], first=0, count=LANES + 1)


class _HiddenLamp:
    """What the dent hides of one lamp."""

    def __init__(
        self,
        lamp: Lamp,
        sweep: Sweep,
        rise_m: float,
        softness_m: float,
        layout: PixelLayout,
        dent: _Dent,
    ) -> None:
        self._lamp, self._sweep, self._layout = lamp, sweep, layout
        self._hidden = Planes(layout.samples**2, layout.geometry.height, layout.blocks)
        self._swept = np.zeros((sweep.step_count, _blocks(sweep.across) * LANES), np.float32)
        self._rays = _rays(sweep, rise_m, softness_m, dent)
        self._highest = np.zeros((self._rays.ray_blocks + 4) * LANES, dtype=np.float32)
        swept = blocks_of(self._swept).reshape((sweep.step_count, -1))
        scratch = self._highest[: -2 * LANES]
        recorded: Any = wp.launch(
            hide_pixels,
            dim=1,
            inputs=[
                self._rays,
                dent.shifted,
                blocks_of(scratch),
                shifted_blocks(scratch, first=0, count=LANES + 1),
            ],
            outputs=[swept],
            device=CPU,
            record_cmd=True,
        )
        self._follow: Task = recorded.launch

    def hide(self) -> None:
        """Find what is hidden, and lay it out as samples are."""
        self._follow()
        hidden = self._swept[:, : self._sweep.across]
        if self._sweep.along_columns:
            hidden = np.asarray(cv2.transpose(hidden), dtype=np.float32)
        samples = self._layout.samples
        columns = slice(LANES, LANES + self._layout.geometry.width)
        for plane, values in enumerate(self._hidden.values):
            a, b = divmod(plane, samples)
            values[:, columns] = hidden[a::samples, b::samples]

    def over(self, band: SampledBand, change: Planes) -> Task:
        """Return what takes the lamp's light from a band's colours."""
        level = math.cos(self._lamp.elevation_rad)
        towards = (
            level * math.cos(self._lamp.azimuth_rad),
            level * math.sin(self._lamp.azimuth_rad),
            math.sin(self._lamp.elevation_rad),
        )
        held, whole = band.buffers, self._layout.geometry.height * (self._layout.blocks + 2)
        recorded: Any = wp.launch(
            darken_blocks,
            dim=(band.rows.stop - band.rows.start) * self._layout.blocks,
            inputs=[
                band.band,
                wp.vec3f(*towards),
                wp.vec3f(*self._lamp.colour),
                whole,
                held.along.shifted,
                held.across.blocks,
                self._hidden.blocks,
            ],
            outputs=[change.blocks.reshape((3, -1))],
            device=CPU,
            record_cmd=True,
        )
        launch: Task = recorded.launch
        return launch


def _rays(sweep: Sweep, rise_m: float, softness_m: float, dent: _Dent) -> Any:
    places = sweep_places(sweep, rise_m)
    rays: Any = Rays()
    rays.forward = int(sweep.forward)
    rays.blocks, rays.ray_blocks = _blocks(sweep.across), _blocks(sweep.ray_count)
    rays.room, rays.pitch = dent.room, dent.pitch
    rays.whole = wp.array(places.whole.astype(np.int32), dtype=wp.int32, device=CPU)
    rays.part = wp.array(places.part, dtype=wp.float32, device=CPU)
    rays.sunk = wp.array(places.sunk_m, dtype=wp.float32, device=CPU)
    rays.per_softness = 1.0 / softness_m
    return rays


def _blocks(count: int) -> int:
    """Return how many blocks hold so many values."""
    return -(-count // LANES)
