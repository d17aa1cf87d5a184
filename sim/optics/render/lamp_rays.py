"""Shadows that a dent casts in the tactile image, found in one sweep along every lamp's rays.

A ray carries the steepest slope from the lamp that the gel has cut off so far: each pixel is
visited once, however long the shadows are. Heights are interpolated linearly across the rays. Seen
from the camera a pressed gel bulges towards it.
"""

import math
from typing import Any

import numpy as np
import warp as wp

from sim.device import Device
from sim.optics.pixels.pixel_blocks import BLOCK_TYPES, CPU_LANES, BlockMemory, PixelBlocks
from sim.optics.pixels.shadow_kernel import Rays, darken_pixels, follow_rays, measure_cells
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.lamps_and_optics import Lamp, ShadowCaster
from tacauchy_rig.core.arrays import Float32Array, RealArray

_NEAREST_SHARE = 0.05  # of an image's size: so far beside it a lamp stands at least
_FAR = 200.0  # sizes of an image: how far off a lamp is that shines from one direction


class DentCells:
    """Where a processor need not look for shadows of dents, shape [count, height, width] [m].

    Attributes:
        limits: Largest change from a sample to the next, and bulge, of each cell [m]. Those have as
            many samples both ways as a block; a GPU looks everywhere.
    """

    def __init__(self, dent: Any, lanes: int) -> None:
        on, count, size = Device(str(dent.device)), len(dent), dent.shape[1:]
        shape = (count, *(-(-each // lanes) if lanes > 1 else 1 for each in size))
        self.dent, self.limits = dent, on.zeros(shape, wp.vec2f)
        like = BLOCK_TYPES[lanes]()
        self.measure = on.record(measure_cells, shape, [like, dent, self.limits]).launch


class HiddenLamp:
    """What dents hide of a lamp.

    Attributes:
        hidden: How much of the lamp is hidden, 0 to 1, by step and ray.
        marks: 1 for cells that are in shadow.
    """

    def __init__(
        self,
        lamp: Lamp,
        shadows: ShadowCaster,
        geometry: CameraGeometry,
        cells: DentCells,
        lanes: int,
    ) -> None:
        on, count = Device(str(cells.dent.device)), len(cells.dent)
        self.rays = rays = rays_from(lamp, shadows, geometry, lanes, on.name)
        steps, size = len(rays.starts), (count, rays.pitch)
        self._memory = BlockMemory(1, steps * count * rays.pitch, lanes, on.name)
        self.hidden, self.marks = self._memory.blocks[0], on.zeros(cells.limits.shape, wp.int32)
        tiles = count * -(-steps // lanes) * rays.pitch if lanes > 1 else 1
        self._kept = cells, on.zeros(tiles, wp.int32)
        inputs = [rays, cells.dent, cells.limits, self.hidden, self._kept[1], self.marks]
        self._follow = on.record(follow_rays, size, inputs).launch

    def follow(self) -> None:
        """Find what is hidden, after the dents' cells are measured."""
        self.marks.zero_()
        self._follow()


def rays_from(
    lamp: Lamp, shadows: ShadowCaster, geometry: CameraGeometry, lanes: int, device: str
) -> Any:
    """Return for kernels how rays from a lamp go over an image.

    A step goes one column or row on, away from the lamp. Rays are a sample apart in the middle
    step, at most twice as far in the last one.
    """
    scales = np.array([geometry.scale_x_m, geometry.scale_y_m])
    counts = np.array([geometry.width, geometry.height])
    ends = (counts - 1) * scales
    distance_m = lamp.distance_m or _FAR * float(ends.max())
    way = np.array([math.cos(lamp.azimuth_rad), math.sin(lamp.azimuth_rad)])
    foot = 0.5 * ends + distance_m * way
    beside = np.maximum(-foot, foot - ends)  # by how much it lies outside of the image
    main = 0 if beside[0] >= beside[1] else 1
    nearest = max(float(beside[main]), _NEAREST_SHARE * float(ends[main]))
    distances = nearest + np.arange(counts[main]) * scales[main]
    side = 1 - main
    reach = np.array([-foot[side], ends[side] - foot[side]])
    apart = scales[side] / distances[len(distances) // 2]
    slopes = reach[:, None] / distances[[0, -1]]
    low, high = float(slopes.min()), float(slopes.max())
    ray_count = math.ceil((high - low) / apart) + 2
    height = distance_m * math.tan(lamp.elevation_rad)
    on = Device(device)
    tables = {
        "starts": (foot[side] + low * distances) / scales[side],
        "spacings": apart * distances / scales[side],
        "per_spacing": scales[side] / (apart * distances),
        "distances": distances,
        "inverses": 1.0 / distances,
        "falls": height * (1.0 / distances - 1.0 / distances[0]),
    }
    return on.tables(
        Rays,
        tables,
        along_columns=int(main == 0),
        forward=int(foot[main] < 0.5 * ends[main]),
        across=int(counts[side]),
        step_stride=1 if main == 0 else int(counts[0]),
        side_stride=int(counts[0]) if main == 0 else 1,
        pitch=-(-ray_count // lanes),
        slope=low,
        slopes_apart=apart,
        softness=shadows.softness_m,
        spread=shadows.spread,
        column=foot[0] / scales[0],
        row=foot[1] / scales[1],
        per_column=scales[0] / distance_m,
        per_row=scales[1] / distance_m,
        height=height / distance_m,
    )


def darkening(
    shadows: ShadowCaster, indentation_m: RealArray, tilt: Float32Array, geometry: CameraGeometry
) -> Float32Array:
    """Return the light taken away [grey levels, not positive], shape [3, height, width]."""
    taken = np.zeros((3, *indentation_m.shape), dtype=np.float32)
    for lamp in shadows.lamps:
        share = lost_share(indentation_m[None], tilt[None], lamp, shadows, geometry)[0]
        taken -= np.array(lamp.colour, dtype=np.float32)[:, None, None] * share
    return taken


def lost_share(
    bulge: RealArray,
    tilt: Float32Array,
    lamp: Lamp,
    shadows: ShadowCaster,
    geometry: CameraGeometry,
) -> Float32Array:
    """Return the share of a lamp's light that dents take away, shape [count, height, width].

    Bulges [m] have this shape, tilts the shape [count, 2, height, width].
    """
    device, lanes = Device("cpu"), CPU_LANES
    layout = PixelBlocks(geometry=geometry, samples=1, device="cpu", lanes=lanes)
    cells = DentCells(device.array(bulge, wp.float32), lanes)
    hidden = HiddenLamp(lamp, shadows, geometry, cells, lanes)
    count, height, width = bulge.shape
    lost = BlockMemory(3, count * height * layout.row_blocks, lanes, "cpu")
    gain = layout.pixel_rows(np.ones((3, height, width)))
    tilts = [layout.sample_planes(tilt[:, axis]) for axis in range(2)]
    light = [hidden.rays, wp.vec3f(-1.0), gain, hidden.hidden, hidden.marks]
    cells.measure()
    hidden.follow()
    size = (count, height, layout.parts)
    device.launch(darken_pixels, size, [layout.layout(), *light, *tilts, lost.blocks], [])
    return np.array(lost.single.numpy()[0].reshape(count, height, -1)[..., :width])
