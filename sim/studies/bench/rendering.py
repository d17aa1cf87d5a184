"""What an image costs: one at a time on the processor, and many at once on a GPU."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from sim.device import Device
from sim.effects.plan import plan_effects
from sim.effects.presets import build_model
from sim.effects.scene_path import path_for
from sim.fields.press_fields import surface_state
from sim.fields.surface import SurfaceState
from sim.optics.colour.nominal import nominal_model
from sim.optics.colour.photometric import PhotometricModel
from sim.optics.colour.polynomial import BALL_EXPONENTS
from sim.optics.colour.shading_terms import NearLamp, ShadingTerms
from sim.optics.height.height_map import height_maps
from sim.optics.render.renderer import TactileRenderer
from sim.optics.surface_images import SurfaceImages
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.sensor import Sensor, load_sensor
from sim.solve.path_point import PathPoint
from sim.studies.bench.parts import times_of
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError

SENSORS = ("gelsight-mini", "digit")
BATCH = 60
_BATCH_ON_CPU = 2
# As a replay renders: so many samples of a pixel both ways, and the blur that presses ask for.
SAMPLES, BLUR_PX = 2, 0.75
_DEPTH_M = 0.5e-3
_GREY = 118
_REPEATS, _REPEATS_LEAST = 50, 5


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderingRow:
    """What rendering took, and whether a batch's images are those of the processor.

    Attributes:
        sensor: Its title.
        renderer: ``one by one`` is what a replay uses, ``batch`` many images in each launch, and
            ``from nodes`` that with their height maps and markers.
        device: Where it ran.
        image_count: Rendered at once.
        shadow_count: Lamps that cast shadows.
        term_count: Of the model of colours.
        median_s: Of all images at once, over the repeats [s].
        least_s: The shortest of them [s].
        apart_levels: Largest difference from the images rendered one by one [grey levels].
        apart_share: Of the channels' values that differ at all.
    """

    sensor: str
    renderer: str
    device: str
    image_count: int
    width_px: int
    height_px: int
    samples: int
    blur_px: float
    shadow_count: int
    term_count: int
    median_s: float
    least_s: float
    repeats: int
    apart_levels: int = 0
    apart_share: float = 0.0

    @property
    def image_ms(self) -> float:
        """Median time of an image [ms]."""
        return 1e3 * self.median_s / self.image_count


def batch_device() -> str:
    """Return the device that batches are for: the first GPU, else the CPU."""
    return "cuda:0" if wp.get_cuda_device_count() > 0 else "cpu"


def measure_rendering(
    scene: Scene, *, sensors: Sequence[str] = SENSORS, budget_s: float = 3.0
) -> Iterator[RenderingRow]:
    """Render an indenter in sensors with coloured lamps, from its height map to bytes.

    Args:
        scene: Its indenter is pressed 0.5 mm deep with preset ``fast``; a batch has that dent at
            as many depths as images.
        budget_s: For each row, about [s].

    Raises:
        ConvergenceError: The gel cannot be pressed that far.
    """
    for name in sensors:
        yield from _on_sensor(scene, name, budget_s)


def _on_sensor(scene: Scene, name: str, budget_s: float) -> Iterator[RenderingRow]:
    device = batch_device()
    sensor, target = load_sensor(name), Target(depth_m=_DEPTH_M)
    pressed = sensor.scene(scene.indenter, target, preset=Preset.FAST)
    path = path_for(pressed, plan_effects(pressed))
    point = path.advance(_DEPTH_M)
    surface = surface_state(path, point)
    many = BATCH if device != "cpu" else _BATCH_ON_CPU
    for samples, count in ((1, 1), (SAMPLES, many)):
        renderer, rest_m, dents_m, row = _look(name, surface, samples=samples, count=count)
        # The deepest dent's image, rendered by itself as a replay does.
        alone = partial(renderer().render, rest_m - dents_m[-1])
        yield row(renderer="one by one", device="cpu", image_count=1, **_times_of(alone, budget_s))
    dents, batch = renderer(device=device).prepared(len(dents_m))
    dents.assign(dents_m.astype(np.float32))
    single = renderer()
    expected = np.stack([single.render(rest_m - dent) for dent in dents_m])
    yield row(**_judged("batch", batch, expected, budget_s))
    yield row(**_from_nodes(pressed, sensor, point, count=many, budget_s=budget_s))


def _from_nodes(
    scene: Scene, sensor: Sensor, point: PathPoint, *, count: int, budget_s: float
) -> dict[str, Any]:
    """Time images and markers of gels that moved by as many shares of a press' displacement."""
    rest, shares = build_model(scene).nodes, np.arange(1, count + 1) / count
    positions = rest + shares[:, None, None] * (point.state.positions - rest)
    tips = point.state.tip + (1.0 - shares[:, None]) * (0.0, 0.0, point.depth_m)
    colours = _as_wide_as_fitted(sensor)

    def drawing(device: str, count: int) -> SurfaceImages:
        return SurfaceImages(
            build_model(scene, device=device),
            scene.indenter,
            sensor,
            count=count,
            samples=SAMPLES,
            colours=colours,
            blur_px=BLUR_PX,
        )

    alone, on_host, on_device = drawing("cpu", 1), Device("cpu"), Device(batch_device())
    expected = [
        alone.images(on_host.array(nodes[None], wp.vec3d), on_host.array(tip[None], wp.vec3d))
        .numpy()
        .copy()
        for nodes, tip in zip(positions, tips, strict=True)
    ]
    many = drawing(on_device.name, count)
    taken = on_device.array(positions, wp.vec3d), on_device.array(tips, wp.vec3d)

    def images() -> Any:
        many.markers(taken[0])
        return many.images(*taken)

    return _judged("from nodes", images, np.concatenate(expected), budget_s)


def _judged(
    renderer: str, draw: Callable[[], Any], expected: ImageArray, budget_s: float
) -> dict[str, Any]:
    """Return what drawing many images takes, and how far they are from those drawn alone."""
    device = batch_device()

    def drawn() -> Any:
        images = draw()
        wp.synchronize_device(device)
        return images

    apart = np.abs(drawn().numpy().astype(np.int16) - expected.astype(np.int16))
    return {
        "renderer": renderer,
        "device": wp.get_device(device).name if device != "cpu" else device,
        "image_count": len(expected),
        "apart_levels": int(apart.max()),
        "apart_share": float(np.mean(apart > 0)),
        **_times_of(drawn, budget_s),
    }


def _look(
    name: str, surface: SurfaceState, *, samples: int, count: int
) -> tuple[Callable[..., TactileRenderer], FloatArray, FloatArray, Callable[..., RenderingRow]]:
    """Return what makes a renderer, heights at rest and dents for it [m], and what makes a row.

    Heights have shape [height, width], dents [count, height, width].
    """
    sensor = load_sensor(name)
    geometry = sensor.camera
    maps = height_maps(surface, geometry.refined(samples), pad=sensor.pad)
    shadows, model = sensor.optics.shadows, _as_wide_as_fitted(sensor)
    grey = np.full((geometry.height, geometry.width, 3), _GREY, dtype=np.uint8)
    look: dict[str, Any] = {"samples": samples, "blur_px": BLUR_PX}
    renderer = partial(TactileRenderer, grey, maps.rest, model, geometry, shadows=shadows, **look)
    row = partial(
        RenderingRow,
        sensor=sensor.title,
        width_px=geometry.width,
        height_px=geometry.height,
        shadow_count=0 if shadows is None else len(shadows.lamps),
        term_count=len(model.exponents) + len(model.term_coefficients),
        **look,
    )
    depths = np.arange(1, count + 1) / count
    return renderer, maps.rest, depths[:, None, None] * (maps.rest - maps.loaded), row


def _as_wide_as_fitted(sensor: Sensor) -> PhotometricModel:
    """Return nominal colours with all the terms that a calibration fits to ball presses.

    Raises:
        ConfigError: The sensor has no coloured lamps.
    """
    model = nominal_model(sensor)
    if not isinstance(model, PhotometricModel):
        raise ConfigError(
            "rendering is timed for sensors with coloured lamps", remedy="choose such a sensor"
        )
    terms = [*map(tuple, BALL_EXPONENTS.tolist())]
    coefficients = np.zeros((len(terms), 3))
    for term, levels in zip(model.exponents.tolist(), model.coefficients, strict=True):
        coefficients[terms.index(tuple(term))] = levels
    lamps = sensor.optics.lamps
    shading = ShadingTerms(
        lamps=tuple(
            NearLamp(azimuth_rad=lamp.azimuth_rad, elevation_rad=lamp.elevation_rad, distance=1.6)
            for lamp in lamps
        ),
        softness=0.1,
        aspect=sensor.camera.height / sensor.camera.width,
        crease_limit=3e3,
    )
    colours = [0.2 * np.array(lamp.colour) for lamp in lamps]
    places = np.array([1.0, 0.1, -0.1])  # level and gradients over the image
    weights = places[:, None] * np.stack([*colours, np.full(3, 5.0)])[:, None]
    return replace(
        model,
        exponents=BALL_EXPONENTS,
        coefficients=coefficients,
        terms=shading,
        term_coefficients=weights.reshape(-1, 3),
    )


def _times_of(act: Callable[[], object], budget_s: float) -> dict[str, Any]:
    times_s = times_of(act, most=_REPEATS, least=_REPEATS_LEAST, budget_s=budget_s)
    return {
        "median_s": float(np.median(times_s)),
        "least_s": min(times_s),
        "repeats": len(times_s),
    }
