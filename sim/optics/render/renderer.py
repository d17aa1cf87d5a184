"""From height maps to tactile images: one at a time on a processor, many at once on a GPU."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

import cv2
import numpy as np
import warp as wp

from sim.device import Device
from sim.optics.colour.model_interface_and_response import ColourModel, PixelColours, SampleColours
from sim.optics.colour.nominal_optics import nominal_model
from sim.optics.height.height_map import HeightMaps
from sim.optics.pixels import blur_and_exposure_kernel as kernels
from sim.optics.pixels.pixel_blocks import CPU_LANES, GPU_LANES, BlockMemory, PixelBlocks
from sim.optics.pixels.shadow_kernel import darken_pixels
from sim.optics.render.lamp_rays import DentCells, HiddenLamp
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.lamps_and_optics import Lamp, ShadowCaster
from sim.sensor.sensor import Sensor
from tacauchy_rig.core.arrays import Float32Array, ImageArray, RealArray
from tacauchy_rig.core.errors import ConfigError

GREY_LEVEL = 110  # of the no-contact frame of a sensor that nobody has calibrated
_REACH = 4.0  # standard deviations of a blur's weights, as in OpenCV for real images

Task = Callable[[], None]


class TactileRenderer:
    """Renders height maps over one no-contact frame.

    image = no-contact frame + model(loaded gel) - model(unloaded gel), less the shadows that the
    dent casts: the unloaded gel gives back the no-contact frame exactly. A pixel is sampled only
    where its surface bends. A processor renders in one thread.

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
        lanes = CPU_LANES if on_cpu else GPU_LANES
        self._blocks = PixelBlocks(geometry=geometry, samples=samples, device=device, lanes=lanes)
        rest = self._blocks.sample_planes(rest_height - rest_height.flat[0])
        frame = background.astype(np.float32).transpose(2, 0, 1)
        self._colours = model.over(frame, self._blocks)
        size = round(2.0 * _REACH * blur_px + 1.0) | 1  # odd: the pixel itself is in the middle
        weights = cv2.getGaussianKernel(size, blur_px, cv2.CV_32F)[:, 0]
        self._weights = np.asarray(weights, dtype=np.float32)
        self._images = partial(_Images, self._blocks, rest, self._colours, shadows, self._weights)
        self._base = self._colours.light - self._blurred_change_at_rest()

    def render(self, height: RealArray) -> ImageArray:
        """Return the image of a height map [m] as RGB, uint8, shape [height, width, 3]."""
        _check_shape("height map", height.shape, self._rest_height.shape)
        dents, rendered = self._single
        host = dents.numpy()  # a processor's own memory
        np.subtract(self._rest_height, height, out=host[0], casting="same_kind")
        if dents.device.is_cuda:
            dents.assign(host)
        return np.array(rendered().numpy()[0])

    def prepared(self, count: int) -> tuple[Any, Callable[[], Any]]:
        """Return where indentations of images are written, and what renders those written there.

        Those are of the samples [m], Warp float32, shape [count, height, width]. Rendering does not
        wait; its images, Warp uint8, shape [count, height, width, 3], the next one overwrites.
        """
        images = self._images(count, self._base)

        def rendered() -> Any:
            for stage in (*images.to_change, *images.to_bytes):
                stage()
            return images.bytes

        return images.dent, rendered

    @cached_property
    def _single(self) -> tuple[Any, Callable[[], Any]]:
        return self.prepared(1)

    def _blurred_change_at_rest(self) -> Float32Array:
        """Return what the model says of the unloaded gel [grey levels], [3, height, width]."""
        images = self._images(1, self._colours.light)
        images.dent.zero_()
        for stage in images.to_change:
            stage()
        change = images.change.pixels(self._blocks).transpose(1, 2, 0)
        weights = self._weights
        mirror = cv2.BORDER_REFLECT_101
        blurred = cv2.sepFilter2D(change, cv2.CV_32F, weights, weights, borderType=mirror)
        return np.asarray(blurred.transpose(2, 0, 1), dtype=np.float32)


class _Images:
    """Memory for some images at a time, and the recorded launches that fill it."""

    def __init__(
        self,
        layout: PixelBlocks,
        rest: Any,
        colours: PixelColours,
        shadows: ShadowCaster | None,
        weights: Float32Array,
        count: int,
        base: Float32Array,
    ) -> None:
        self._layout, self._count, self._device = layout, count, Device(layout.device)
        geometry = layout.geometry
        fine, empty = geometry.refined(layout.samples), self._device.empty
        self.dent: Any = empty((count, fine.height, fine.width), wp.float32)  # of the samples [m]
        self.bytes: Any = empty((count, geometry.height, geometry.width, 3), wp.uint8)
        blocks = count * geometry.height * layout.row_blocks
        self.change = BlockMemory(3, blocks, layout.lanes, layout.device)
        # Stages from dents to changes of light, and on to bytes:
        self.to_change = self._coloured(rest, colours)
        if shadows is not None:
            gain = np.ones_like(colours.light) if colours.gain is None else colours.gain
            gain_blocks = layout.pixel_rows(gain)
            cells = DentCells(self.dent, layout.lanes)
            self.to_change.append(cells.measure)
            for lamp in shadows.lamps:
                self.to_change += self._darkened(lamp, shadows, cells, gain_blocks)
        self.to_bytes = self._exposed(weights, base, colours.response.knee)

    def _coloured(self, rest: Any, colours: PixelColours) -> list[Task]:
        layout, count = self._layout, self._count
        planes = [layout.planes(count) for _ in range(4)]
        self._dents, self._height, self._along, self._across = planes
        self._kept = [rest, *colours.inputs]

        def go_on(along_rows: BlockMemory, along_columns: BlockMemory) -> Task:
            inputs = [layout.lanes, along_rows.single[0], along_columns.single[0]]
            return self._record(kernels.continue_samples, (sum(self.dent.shape[1:]),), inputs)

        dents, height = self._dents.blocks[0], self._height.blocks[0]
        tilts = [self._along.blocks[0], self._across.blocks[0]]
        taken = [*tilts, dents, self.change.blocks]
        return [
            self._by_blocks(kernels.lay_out_samples, [rest, self.dent, dents, height]),
            go_on(self._height, self._height),
            self._by_blocks(kernels.tilt_samples, [height, *tilts]),
            go_on(self._along, self._across),
            self._by_blocks(colours.kernel, [*colours.inputs, *taken])
            if colours.function is None
            else partial(self._call, colours.function),
        ]

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

    def _darkened(
        self, lamp: Lamp, shadows: ShadowCaster, cells: DentCells, gain: Any
    ) -> list[Task]:
        layout = self._layout
        fine = layout.geometry.refined(layout.samples)
        hidden = HiddenLamp(lamp, shadows, fine, cells, layout.lanes)
        self._kept.append(hidden)
        light = [hidden.rays, wp.vec3f(*lamp.colour), gain]
        samples = [hidden.hidden, hidden.marks, self._along.blocks[0], self._across.blocks[0]]
        return [
            hidden.follow,
            self._by_blocks(darken_pixels, [*light, *samples, self.change.blocks]),
        ]

    def _exposed(self, weights: Float32Array, base: Float32Array, knee: float) -> list[Task]:
        layout, rows = self._layout, self._layout.geometry.height
        reach = len(weights) // 2
        room = -(-reach // layout.lanes)
        count = self._count * rows * (layout.row_blocks + 2 * room)
        blurred = BlockMemory(3, count, layout.lanes, layout.device, reach=reach)
        taps, base_blocks = layout.array(weights), layout.pixel_rows(base)
        self._kept += [blurred, taps, base_blocks]
        flat = blurred.single.reshape((3, self._count * rows, -1))
        mirror = [reach, room * layout.lanes, flat]
        expose = [taps, room, knee, base_blocks, blurred.blocks, self.bytes]
        return [
            self._by_blocks(kernels.blur_columns, [taps, room, self.change.blocks, blurred.blocks]),
            self._record(kernels.mirror_ends, (rows, 3), mirror),
            self._by_blocks(kernels.expose_pixels, expose),
        ]

    def _by_blocks(self, kernel: Any, inputs: list[Any]) -> Task:
        layout = self._layout
        return self._record(kernel, (layout.geometry.height, layout.parts), inputs)

    def _record(self, kernel: Any, inner: tuple[int, ...], inputs: list[Any]) -> Task:
        taken = [self._layout.layout(), *inputs]
        launch: Task = self._device.record(kernel, (self._count, *inner), taken).launch
        return launch


def nominal_renderer(
    sensor: Sensor, *, level: int = GREY_LEVEL, samples: int = 1
) -> Callable[[HeightMaps], ImageArray]:
    """Return what renders the loaded gel uncalibrated over an evenly grey no-contact frame."""
    model, geometry = nominal_model(sensor), sensor.camera
    even = np.full((geometry.height, geometry.width, 3), level, dtype=np.uint8)
    ready = partial(TactileRenderer, shadows=sensor.optics.shadows, samples=samples)
    return lambda maps: ready(even, maps.rest, model, geometry).render(maps.loaded)


def _check_shape(name: str, shape: tuple[int, ...], expected: tuple[int, ...]) -> None:
    if shape != expected:
        raise ConfigError(
            f"{name} has the shape {shape}, the sensor's camera {expected}",
            remedy="bring frames to the sensor's size, and use one geometry throughout",
        )
