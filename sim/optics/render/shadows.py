"""Shadows that a dent casts in the tactile image.

A shadow is the highest thing over each pixel's ray to a lamp, found in one sweep from every lamp.
Heights are sheared so that the lamp stands at the end of the columns. From there the sweep carries
the highest ray so far, lowered by what a ray sinks in a step: each pixel is visited once, however
long the shadows are. Heights between pixels are interpolated linearly across the rays.

Seen from the camera a pressed gel bulges towards it; a lamp that grazes the gel leaves the gel
behind it dark.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import warp as wp

from sim.device import Device
from sim.optics.pixels.pixel_blocks import CPU_LANES, BlockMemory
from sim.optics.pixels.pixel_kernel import Rays, follow_rays, hide_samples, turn_dents
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.optics import Lamp, ShadowCaster
from tacauchy_rig.core.arrays import Float32Array, RealArray

_RAY_ROOM = 2  # blocks beside the rays of a step, which their neighbours are read from


class HiddenLamp:
    """What a dent, a device's array of shape [count, height, width] [m], hides of a lamp.

    Attributes:
        highest: Room for a value a step and ray, which another lamp may take over.
        hidden: How much of the lamp samples do not see, 0 to 1, in the order of the rays.
        stages: Kernels, each with the counts over which it may be parted and others, and inputs.
    """

    def __init__(
        self,
        lamp: Lamp,
        softness_m: float,
        geometry: CameraGeometry,
        dent: Any,
        lanes: int,
        highest: BlockMemory | None = None,
    ) -> None:
        self.rays = rays = rays_towards(lamp, geometry, softness_m, lanes, str(dent.device))
        self._lanes = lanes
        step_count = len(rays.whole)
        blocks, ray_blocks = -(-rays.across // lanes), rays.ray_pitch - _RAY_ROOM
        steps = dent.shape[0] * step_count
        self.hidden = BlockMemory(1, steps * rays.pitch, lanes, str(dent.device), reach=lanes + 1)
        needed = steps * rays.ray_pitch
        if highest is None or highest.blocks.size < needed:
            highest = BlockMemory(1, needed, lanes, str(dent.device), reach=lanes + 1)
        self.highest = highest
        dents, passed = self.hidden.blocks[0], highest.shifted[1:, 0]
        self.stages: list[tuple[Any, int, tuple[int, ...], list[Any]]] = [
            (turn_dents, step_count, (blocks,), [dent, dents]),
            (follow_rays, ray_blocks, (), [self.hidden.shifted[1:, 0], highest.blocks[0]]),
            (hide_samples, step_count, (blocks,), [passed, dents]),
        ]

    def share(self) -> Float32Array:
        """Return how much of the lamp is hidden in the first image, shape [height, width]."""
        rays, lanes = self.rays, self._lanes
        room = rays.room * lanes
        turned = self.hidden.single.numpy().reshape(-1, rays.pitch * lanes)
        turned = turned[: len(rays.whole), room : room + rays.across]
        shown = turned if rays.forward else turned[::-1]
        return np.asarray(shown.T if rays.along_columns else shown)


def rays_towards(
    lamp: Lamp, geometry: CameraGeometry, softness_m: float, lanes: int, device: str
) -> Any:
    """Return for kernels how rays towards a lamp go over an image.

    A step goes one column or row on, towards higher ones if ``forward``; a ray moves across by at
    most a pixel in a step, and rises.
    """
    right, down = math.cos(lamp.azimuth_rad), math.sin(lamp.azimuth_rad)
    along_columns = abs(right) >= abs(down)
    ahead, aside = (right, down) if along_columns else (down, right)
    shift = aside / abs(ahead)  # across in a step [px]
    rise_m = math.tan(lamp.elevation_rad) * (math.hypot(1.0, shift) * geometry.mean_scale_m)
    sides = (geometry.width, geometry.height)
    step_count, across = sides if along_columns else sides[::-1]
    margin = math.ceil((step_count - 1) * abs(shift))  # by which rays move across in all [px]
    steps = np.arange(step_count)
    first = margin + 1 if shift > 0.0 else 1  # ray through the first pixel
    places = steps * shift - first
    whole = np.floor(places)
    array = Device(device).array
    rays: Any = Rays()
    rays.along_columns, rays.forward = int(along_columns), int(ahead > 0.0)
    rays.across = across
    rays.room = -(-(margin + 2) // lanes)
    rays.pitch = -(-across // lanes) + 2 * rays.room + 1
    rays.ray_pitch = -(-(across + margin + 1) // lanes) + _RAY_ROOM
    rays.whole = array(whole.astype(np.int32), wp.int32)
    rays.part = array((places - whole).astype(np.float32), wp.float32)
    rays.sunk = array((steps * rise_m).astype(np.float32), wp.float32)
    rays.per_softness = 1.0 / softness_m
    return rays


def darkening(
    shadows: ShadowCaster, indentation_m: RealArray, tilt: Float32Array, geometry: CameraGeometry
) -> Float32Array:
    """Return the light taken away [grey levels, not positive], shape [3, height, width]."""
    taken = np.zeros((3, *indentation_m.shape), dtype=np.float32)
    for lamp in shadows.lamps:
        share = lost_share(indentation_m, tilt, lamp, geometry, softness_m=shadows.softness_m)
        taken -= np.array(lamp.colour, dtype=np.float32)[:, None, None] * share
    return taken


def lost_share(
    bulge: RealArray, tilt: Float32Array, lamp: Lamp, geometry: CameraGeometry, *, softness_m: float
) -> Float32Array:
    """Return the share of a lamp's light that a dent takes away, shape [height, width]."""
    device = Device("cpu")
    dent = device.array(bulge[None].astype(np.float32), wp.float32)
    hidden = HiddenLamp(lamp, softness_m, geometry, dent, CPU_LANES)
    for kernel, count, inner, inputs in hidden.stages:
        device.launch(kernel, (1, count, *inner), [hidden.rays, 0, *inputs], [])
    along, across, up = lamp.towards
    facing = along * tilt[0] + across * tilt[1] + up * np.sqrt(1.0 - tilt[0] ** 2 - tilt[1] ** 2)
    return np.asarray(hidden.share() * np.maximum(facing, 0.0), dtype=np.float32)
