"""From height maps to tactile images: one at a time on a processor, many at once on a GPU.

Shadows are found in one sweep along the rays that part from every lamp. A ray carries the steepest
slope from the lamp that the gel has cut off so far: each pixel is visited once, however long the
shadows are. Heights between pixels are interpolated linearly across the rays. As a lamp has a size,
the penumbra widens with the distance from what casts the shadow.

Seen from the camera a pressed gel bulges towards it; a lamp that grazes the gel leaves the gel
behind it dark.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import warp as wp

from sim.device import Device
from sim.optics.colour.colour_model import ColourModel, PixelColours, SampleColours
from sim.optics.colour.nominal import nominal_model
from sim.optics.height.height_map import HeightMaps
from sim.optics.pixels.pixel_blocks import CPU_LANES, GPU_LANES, BlockMemory, PixelBlocks
from sim.optics.pixels.pixel_kernel import (
    Rays,
    blur_columns,
    continue_samples,
    darken_pixels,
    expose_pixels,
    follow_rays,
    lay_out_samples,
    lose_light,
    mirror_ends,
    tilt_samples,
    turn_dents,
)
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.optics import Lamp, ShadowCaster
from sim.sensor.sensor import Sensor
from tacauchy_rig.core.arrays import Float32Array, ImageArray, RealArray
from tacauchy_rig.core.errors import ConfigError

GREY_LEVEL = 110  # of the no-contact frame of a sensor that nobody has calibrated
_REACH = 4.0  # standard deviations of a blur's weights, as in OpenCV for real images
_CPU_THREADS = 2
_NEAREST_SHARE = 0.05  # of an image's size: so far beside it a lamp stands at least
_FAR = 200.0  # sizes of an image: how far off a lamp is that shines from one direction

Task = Callable[[], None]


class TactileRenderer:
    """Renders height maps over one no-contact frame.

    image = no-contact frame + model(loaded gel) - model(unloaded gel), less the shadows that the
    dent casts: the unloaded gel gives back the no-contact frame exactly. A pixel is sampled only
    where its surface bends. On a processor two threads share each image.

    Args:
        background: No-contact frame, RGB, shape [height, width, 3].
        rest_height: Height map of the unloaded gel [m], shape [height, width].
        shadows: Lamps that the dent hides; None where the sensor shows no shadows.
        samples: Into how many samples each pixel is divided both ways: a pixel gathers the light
            of its whole area, which at a sharp rim no single point stands for. Height maps are
            then of ``geometry.refined(samples)``.
        blur_px: Standard deviation of the camera's blur [px].

    Raises:
        ConfigError: An image or map has not the geometry's size.
    """

    def __init__(
        self,
        background: ImageArray,
        rest_height: RealArray,
        model: ColourModel,
        geometry: CameraGeometry,
        *,
        shadows: ShadowCaster | None = None,
        samples: int = 1,
        blur_px: float = 0.0,
        device: str = "cpu",
    ) -> None:
        fine = geometry.refined(samples)
        _check_shape("no-contact frame", background.shape, (geometry.height, geometry.width, 3))
        _check_shape("unloaded height map", rest_height.shape, (fine.height, fine.width))
        on_cpu = not Device(device).is_gpu
        self._rest_height = rest_height
        self._blocks = PixelBlocks(
            geometry=geometry,
            samples=samples,
            device=device,
            lanes=CPU_LANES if on_cpu else GPU_LANES,
        )
        self._rest = self._blocks.sample_planes(rest_height - rest_height.flat[0])
        frame = background.astype(np.float32).transpose(2, 0, 1)
        self._colours = model.over(frame, self._blocks)
        self._shadows = shadows
        self._weights = gaussian_weights(blur_px)
        self._threads = ThreadPoolExecutor(_CPU_THREADS - 1, "rendering") if on_cpu else None
        self._images: dict[int, _Images] = {}
        self._base = self._colours.light - self._blurred_change_at_rest()
        self._images.clear()

    def render(self, height: RealArray) -> ImageArray:
        """Return the image of a height map [m] as RGB, uint8, shape [height, width, 3]."""
        _check_shape("height map", height.shape, self._rest_height.shape)
        dents, rendered = self.prepared(1)
        dents.assign((self._rest_height - height)[None].astype(np.float32))
        return np.array(rendered().numpy()[0])

    def prepared(self, count: int) -> tuple[Any, Callable[[], Any]]:
        """Return where indentations of images are written, and what renders those written there.

        The indentations [m] are a Warp float32 array of shape [count, height, width], of the
        samples. Rendering launches and does not wait; its images are a Warp array of uint8, shape
        [count, height, width, 3], that the next rendering of as many overwrites.
        """
        images = self._images_of(count, self._base)
        return images.dent, partial(self._rendered, images)

    def _rendered(self, images: _Images) -> Any:
        self._run(images.to_change)
        self._run(images.to_bytes)
        return images.bytes

    def _blurred_change_at_rest(self) -> Float32Array:
        """Return what the model says of the unloaded gel [grey levels], [3, height, width]."""
        images = self._images_of(1, self._colours.light)
        images.dent.zero_()
        self._run(images.to_change)
        change = images.change.pixels(self._blocks).transpose(1, 2, 0)
        weights = self._weights
        blurred = cv2.sepFilter2D(
            change, cv2.CV_32F, weights, weights, borderType=cv2.BORDER_REFLECT_101
        )
        return np.asarray(blurred.transpose(2, 0, 1), dtype=np.float32)

    def _images_of(self, count: int, base: Float32Array) -> _Images:
        if count not in self._images:
            self._images[count] = _Images(
                self._blocks, count, self._rest, self._colours, self._shadows, self._weights, base
            )
        return self._images[count]

    def _run(self, stages: Sequence[Sequence[Task]]) -> None:
        """Do stages one after the other, the parts of each side by side."""
        for first, *others in stages:
            waiting = [self._threads.submit(other) for other in others] if self._threads else []
            try:
                first()
            finally:
                for other in waiting:
                    other.result()


class _Images:
    """Memory for some images at a time, and the recorded launches that fill it.

    Attributes:
        dent: Indentations of the samples [m], shape [count, height, width] of them.
        change: Change of light of pixels, channel by channel.
        bytes: Of the images, shape [count, height, width, 3].
        to_change, to_bytes: Stages from dents to changes of light, and on to bytes, each of parts.
    """

    def __init__(
        self,
        layout: PixelBlocks,
        count: int,
        rest: Any,
        colours: PixelColours,
        shadows: ShadowCaster | None,
        weights: Float32Array,
        base: Float32Array,
    ) -> None:
        self._layout, self._count, self._device = layout, count, Device(layout.device)
        geometry = layout.geometry
        fine, empty = geometry.refined(layout.samples), self._device.empty
        self.dent: Any = empty((count, fine.height, fine.width), wp.float32)
        self.bytes: Any = empty((count, geometry.height, geometry.width, 3), wp.uint8)
        blocks = count * geometry.height * layout.row_blocks
        self.change = BlockMemory(3, blocks, layout.lanes, layout.device)
        self.to_change = self._coloured(rest, colours)
        if shadows is not None:
            for lamp in shadows.lamps:
                self.to_change += self._darkened(lamp, shadows)
        self.to_bytes = self._exposed(weights, base, colours.response.knee)

    def _coloured(self, rest: Any, colours: PixelColours) -> list[list[Task]]:
        layout, count = self._layout, self._count
        self._dents, self._height, self._along, self._across = (
            layout.planes(count) for _ in range(4)
        )
        self._kept = [rest, *colours.inputs]

        def go_on(planes: BlockMemory) -> list[Task]:
            inputs = [layout.layout(), layout.lanes, planes.single[0]]
            size = (count, sum(self.dent.shape[1:]))
            return [self._device.record(continue_samples, size, inputs).launch]

        dents, height = self._dents.blocks[0], self._height.blocks[0]
        tilts = [self._along.blocks[0], self._across.blocks[0]]
        return [
            self._by_blocks(lay_out_samples, [rest, self.dent, dents, height]),
            go_on(self._height),
            self._by_blocks(tilt_samples, [self._height.shifted[:, 0], *tilts]),
            go_on(self._along),
            go_on(self._across),
            self._changed(colours),
        ]

    def _changed(self, colours: PixelColours) -> list[Task]:
        if colours.function is not None:
            return [partial(self._call, colours.function)]
        tilts = [self._along.shifted[:, 0], self._across.blocks[0]]
        taken = [*colours.inputs, *tilts, self._dents.blocks[0], self.change.blocks]
        return self._by_blocks(colours.kernel, taken)

    def _call(self, function: SampleColours) -> None:
        """Have a NumPy function say the change of light of the samples, image by image."""
        layout, n = self._layout, self._layout.samples
        along, across = layout.samples_of(self._along), layout.samples_of(self._across)
        changes = []
        for tilt, dent in zip(np.stack([along, across], axis=1), self.dent.numpy(), strict=True):
            change = function(tilt, dent)
            _check_shape("a renderer's change of light", change.shape, (3, *dent.shape))
            split = change.reshape(3, dent.shape[0] // n, n, dent.shape[1] // n, n)
            changes.append(split.mean(axis=(2, 4)))
            if not np.isfinite(changes[-1]).all():
                raise ConfigError(
                    "a renderer's change of light is not finite",
                    remedy="correct the function of NumPy that optics.kind stands for",
                )
        wp.copy(self.change.blocks, layout.pixel_rows(np.stack(changes, axis=1)))

    def _darkened(self, lamp: Lamp, shadows: ShadowCaster) -> list[list[Task]]:
        layout = self._layout
        fine = layout.geometry.refined(layout.samples)
        hidden = HiddenLamp(lamp, shadows, fine, self.dent, layout.lanes)
        self._kept.append(hidden)
        light = [hidden.rays, wp.vec3f(*lamp.colour)]
        samples = [hidden.hidden.single[0], self._along.blocks[0], self._across.blocks[0]]
        return [
            *(
                self._in_parts(kernel, hidden.rays, count, inner, inputs)
                for kernel, count, inner, inputs in hidden.stages
            ),
            self._by_blocks(darken_pixels, [*light, *samples, self.change.blocks]),
        ]

    def _exposed(self, weights: Float32Array, base: Float32Array, knee: float) -> list[list[Task]]:
        layout, rows = self._layout, self._layout.geometry.height
        reach = len(weights) // 2
        room = -(-reach // layout.lanes)
        count = self._count * rows * (layout.row_blocks + 2 * room)
        blurred = BlockMemory(3, count, layout.lanes, layout.device, reach=reach)
        taps, base_blocks = layout.array(weights), layout.pixel_rows(base)
        self._kept += [blurred, taps, base_blocks]
        flat = blurred.single.reshape((3, self._count * rows, -1))
        mirror = [reach, room * layout.lanes, flat]
        expose = [taps, room, knee, base_blocks, blurred.shifted, self.bytes]
        return [
            self._by_blocks(blur_columns, [taps, room, self.change.blocks, blurred.blocks]),
            self._in_parts(mirror_ends, layout.layout(), rows, (3,), mirror),
            self._by_blocks(expose_pixels, expose),
        ]

    def _by_blocks(self, kernel: Any, inputs: list[Any]) -> list[Task]:
        layout = self._layout
        rows, blocks = layout.geometry.height, layout.row_blocks
        return self._in_parts(kernel, layout.layout(), rows, (blocks,), inputs)

    def _in_parts(
        self, kernel: Any, layout: Any, count: int, inner: tuple[int, ...], inputs: list[Any]
    ) -> list[Task]:
        """Record a launch over images, rows (or rays) and what is in them, a part a thread."""
        parts = 1 if self._device.is_gpu else _CPU_THREADS
        ends = [count * part // parts for part in range(parts + 1)]
        sizes = [(start, (self._count, stop - start, *inner)) for start, stop in pairwise(ends)]
        record = self._device.record
        return [record(kernel, size, [layout, at, *inputs]).launch for at, size in sizes]


class HiddenLamp:
    """What a dent, a device's array of shape [count, height, width] [m], hides of a lamp.

    Attributes:
        hidden: How much of the lamp is hidden, 0 to 1, by step and ray.
        stages: Kernels, each with the counts over which it may be parted and others, and inputs.
    """

    def __init__(
        self, lamp: Lamp, shadows: ShadowCaster, geometry: CameraGeometry, dent: Any, lanes: int
    ) -> None:
        self.rays = rays = rays_from(lamp, shadows, geometry, lanes, str(dent.device))
        step_count = len(rays.starts)
        self.hidden = BlockMemory(
            1, dent.shape[0] * step_count * rays.pitch, lanes, str(dent.device)
        )
        values = self.hidden.blocks[0]
        self.stages: list[tuple[Any, int, tuple[int, ...], list[Any]]] = [
            (turn_dents, step_count, (rays.pitch,), [dent.flatten(), values]),
            (follow_rays, rays.pitch, (), [values]),
        ]


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
        share = lost_share(indentation_m, tilt, lamp, shadows, geometry)
        taken -= np.array(lamp.colour, dtype=np.float32)[:, None, None] * share
    return taken


def lost_share(
    bulge: RealArray,
    tilt: Float32Array,
    lamp: Lamp,
    shadows: ShadowCaster,
    geometry: CameraGeometry,
) -> Float32Array:
    """Return the share of a lamp's light that a dent takes away, shape [height, width]."""
    device = Device("cpu")
    dent = device.array(bulge[None], wp.float32)
    hidden = HiddenLamp(lamp, shadows, geometry, dent, CPU_LANES)
    for kernel, count, inner, inputs in hidden.stages:
        device.launch(kernel, (1, count, *inner), [hidden.rays, 0, *inputs], [])
    lost = device.empty(bulge.shape, wp.float32)
    inputs = [hidden.rays, CPU_LANES, hidden.hidden.single[0], device.array(tilt, wp.float32)]
    device.launch(lose_light, bulge.shape, inputs, [lost])
    return np.asarray(lost.numpy())


def nominal_renderer(
    sensor: Sensor, *, level: int = GREY_LEVEL, samples: int = 1
) -> Callable[[HeightMaps], ImageArray]:
    """Return what renders the loaded gel uncalibrated over an evenly grey no-contact frame."""
    model, geometry = nominal_model(sensor), sensor.camera
    even = np.full((geometry.height, geometry.width, 3), level, dtype=np.uint8)
    ready = partial(TactileRenderer, shadows=sensor.optics.shadows, samples=samples)
    return lambda maps: ready(even, maps.rest, model, geometry).render(maps.loaded)


def gaussian_weights(sigma_px: float) -> Float32Array:
    """Return the weights of a pixel and its neighbours in a row or column, their sum 1.

    The pixel itself is in the middle; a standard deviation of 0 px leaves it alone.
    """
    size = round(2.0 * _REACH * sigma_px + 1.0) | 1
    return np.asarray(cv2.getGaussianKernel(size, sigma_px, cv2.CV_32F)[:, 0], dtype=np.float32)


def _check_shape(name: str, shape: tuple[int, ...], expected: tuple[int, ...]) -> None:
    if shape != expected:
        raise ConfigError(
            f"{name} has the shape {shape}, the sensor's camera {expected}",
            remedy="bring frames to the sensor's size, and use one geometry throughout",
        )
