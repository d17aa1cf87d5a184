"""What a replay takes, and an image: one at a time on the processor, many at once on a GPU."""

import resource
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from sim.cheapest_setting import keeping, setting_of
from sim.device import Device
from sim.effects.effect_choice import plan_effects
from sim.effects.presets import build_model
from sim.effects.press_with_effects import path_for
from sim.fields.saved_press import SurfaceState, surface_state
from sim.optics.colour.nominal_optics import nominal_model
from sim.optics.colour.photometric import BALL_EXPONENTS, NearLamp, PhotometricModel, ShadingTerms
from sim.optics.height.height_map import height_maps
from sim.optics.markers.marker_tracking import find_markers
from sim.optics.markers.simulated_markers import MarkerPrinter, draw_markers, marker_places
from sim.optics.render.renderer import TactileRenderer
from sim.optics.surface_images import SurfaceImages
from sim.replay import replay_forces, replay_scene
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.sensor import Sensor, load_sensor
from sim.solve.path_point import PathPoint
from sim.tolerance import Tolerance
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.markdown_page import table_prose
from tacauchy_rig.core.tables import Table, table_of_rows

SENSORS = ("gelsight-mini", "digit")
BATCH = 60
_BATCH_ON_CPU = 2
# As a replay renders: so many samples of a pixel both ways, and the blur that presses ask for.
SAMPLES, BLUR_PX = 2, 0.75
_DEPTH_M = 0.5e-3
_GREY = 118
_REPEATS, _REPEATS_LEAST = 50, 5
# Of an image [ms]. 5,550 frames a second, ten times the paper's (with stress, GPU), leave as much
# for all of a frame as the last.
_LIMITS_MS = {"one by one": 5.0, "batch": 0.2, "from nodes": 0.18}

Row = dict[str, Any]
"""A row by the headings of its table, units in brackets."""
ImageOf = Callable[[SurfaceState], ImageArray]

FORCE_ERROR_MAX, TIME_MAX_S = 0.02, 20.0
MEMORY_MAX_MIB = 2e9 / 1024.0**2
BELIEVED = "F_z believed within [%]"
_prose = partial(table_prose, "sim.studies.bench", "tables.md.jinja")


def peak_memory_mib() -> float:
    """Return the largest resident set so far [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def measure_replay(
    scene: Scene,
    forces_n: Sequence[float],
    image_of: ImageOf,
    *,
    tolerance: Tolerance | None = None,
) -> Row:
    """Replay forces [N] on a scene's sensor and indenter: mesh, presses, fields and images.

    With a tolerance of F_z the cheapest settings that state it are taken in place of the scene's
    preset, and choosing them is in the time.
    """
    started = time.perf_counter()
    asked = replay_scene(load_sensor(scene.sensor), scene.indenter, forces_n, preset=scene.preset)
    asked = asked if tolerance is None else keeping(asked, tolerance)
    found, fields = replay_forces(asked, forces_n)
    pressed = time.perf_counter()
    for trial in fields:
        image_of(trial.surface)
    ended = time.perf_counter()
    errors = [trial.force_error_estimate for trial in found.trials]
    known = [error for error in errors if error is not None]
    return {
        "preset": str(setting_of(asked)),
        "presses": len(found.trials),
        BELIEVED: 1e2 * max(known) if len(known) == len(errors) else None,
        "iterations": sum(trial.newton_iterations for trial in found.trials),
        "presses and fields [s]": pressed - started,
        "images [s]": ended - pressed,
        "together [s]": ended - started,
        "peak memory [MiB]": peak_memory_mib(),
    }


def replay_table(rows: Sequence[Row]) -> Table:
    """Return the replays; one that is within 2 % has to be quick and small."""

    def counts(row: Row) -> bool:
        is_close = row[BELIEVED] is not None and row[BELIEVED] <= 1e2 * FORCE_ERROR_MAX
        is_small = row["peak memory [MiB]"] < MEMORY_MAX_MIB
        return bool(is_close and is_small and row["together [s]"] < TIME_MAX_S)

    limits = {"time_max_s": TIME_MAX_S, "memory_max_mib": MEMORY_MAX_MIB}
    prose = _prose("replays", error_max=FORCE_ERROR_MAX, samples=SAMPLES, **limits)
    return table_of_rows(rows, passed=any(map(counts, rows)), **prose)


def batch_device() -> str:
    """Return the device that batches are for: the first GPU, else the CPU."""
    return "cuda:0" if wp.get_cuda_device_count() > 0 else "cpu"


def measure_rendering(
    scene: Scene, *, sensors: Sequence[str] = SENSORS, budget_s: float = 3.0
) -> Iterator[Row]:
    """Render an indenter in sensors with coloured lamps, from its height map to bytes.

    ``one by one`` is what a replay uses, ``batch`` many images in each launch, and ``from nodes``
    that with their height maps and markers.

    Args:
        scene: Its indenter is pressed 0.5 mm deep with preset ``fast``; a batch has that dent at
            as many depths as images.
        budget_s: For each row, about [s].
    """
    device = batch_device()
    many = BATCH if device != "cpu" else _BATCH_ON_CPU
    for name in sensors:
        sensor = load_sensor(name)
        pressed = sensor.scene(scene.indenter, Target(depth_m=_DEPTH_M), preset=Preset.FAST)
        path = path_for(pressed, plan_effects(pressed))
        point = path.advance(_DEPTH_M)
        surface = surface_state(path, point)
        for samples, count in ((1, 1), (SAMPLES, many)):
            renderer, rest_m, dents_m = _look(sensor, surface, samples=samples, count=count)
            row = partial(_row, sensor, samples)
            # The deepest dent's image, rendered by itself as a replay does.
            bare = partial(renderer().render, rest_m - dents_m[-1])
            alone, markers = _with_markers(sensor, surface, bare)
            yield row("one by one", times_of(alone, budget_s=budget_s), markers=markers)
        dents, batch = renderer(device=device).prepared(len(dents_m))
        dents.assign(dents_m.astype(np.float32))
        single = renderer()
        expected = np.stack([single.render(rest_m - dent) for dent in dents_m])
        yield row("batch", **_judged(batch, expected, budget_s))
        from_nodes = _from_nodes(pressed, sensor, point, count=many, budget_s=budget_s)
        yield row("from nodes", **from_nodes)


def _row(
    sensor: Sensor,
    samples: int,
    renderer: str,
    times_s: Sequence[float],
    device: str = "cpu",
    count: int = 1,
    apart: tuple[int, float] = (0, 0.0),
    markers: int = 0,
) -> Row:
    """Return a row; ``apart`` is the largest difference from images drawn alone, and its share."""
    shadows = sensor.optics.shadows
    return {
        "sensor": sensor.title,
        "renderer": renderer,
        "device": device,
        "images": count,
        "samples": f"{samples}x{samples}",
        "shadows": 0 if shadows is None else len(shadows.lamps),
        "markers": markers,
        "image [ms]": 1e3 * float(np.median(times_s)) / count,
        "least [ms]": 1e3 * min(times_s) / count,
        "apart [levels]": apart[0],
        "apart [%]": 1e2 * apart[1],
    }


def rendering_table(rows: Sequence[Row]) -> Table:
    """Return what images take, and how far a batch's are from those rendered one by one."""
    judged = [row for row in rows if row["images"] in (1, BATCH)]
    sensor = load_sensor(SENSORS[0])
    model = _as_wide_as_fitted(sensor)
    prose = _prose(
        "rendering",
        limits=_LIMITS_MS,
        batch=BATCH,
        camera=sensor.camera,
        term_count=len(model.exponents) + len(model.term_coefficients),
        blur_px=f"{BLUR_PX:g}",
        samples=SAMPLES,
        has_gpu=batch_device() != "cpu",
    )
    is_quick = all(row["image [ms]"] < _LIMITS_MS[row["renderer"]] for row in judged)
    is_same = all(row["apart [levels]"] <= 1 for row in rows)
    return table_of_rows(rows, passed=is_quick and is_same, **prose)


def _from_nodes(
    scene: Scene, sensor: Sensor, point: PathPoint, *, count: int, budget_s: float
) -> dict[str, Any]:
    """Time images and markers of gels that moved by as many shares of a press' displacement."""
    rest, shares = build_model(scene).nodes, np.arange(1, count + 1) / count
    positions = rest + shares[:, None, None] * (point.state.positions - rest)
    tips = point.state.tip + (1.0 - shares[:, None]) * (0.0, 0.0, point.depth_m)
    colours = _as_wide_as_fitted(sensor)

    def drawing(device: str, count: int) -> SurfaceImages:
        look: Any = {"samples": SAMPLES, "colours": colours, "blur_px": BLUR_PX}
        model = build_model(scene, device=device)
        return SurfaceImages(model, scene.indenter, sensor, count=count, **look)

    def on(device: str, *places: FloatArray) -> list[Any]:
        return [Device(device).array(each, wp.vec3d) for each in places]

    alone, many = drawing("cpu", 1), drawing(batch_device(), count)
    expected = [
        alone.images(*on("cpu", nodes[None], tip[None])).numpy().copy()
        for nodes, tip in zip(positions, tips, strict=True)
    ]
    taken = on(batch_device(), positions, tips)

    def images() -> Any:
        many.markers(taken[0])
        return many.images(*taken)

    return _judged(images, np.concatenate(expected), budget_s)


def _judged(draw: Callable[[], Any], expected: ImageArray, budget_s: float) -> dict[str, Any]:
    """Return of a row what drawing many images takes, and how far they are from those alone."""
    device = batch_device()

    def drawn() -> Any:
        images = draw()
        wp.synchronize_device(device)
        return images

    apart = np.abs(drawn().numpy().astype(np.int16) - expected.astype(np.int16))
    return {
        "times_s": times_of(drawn, budget_s=budget_s),
        "device": wp.get_device(device).name if device != "cpu" else device,
        "count": len(expected),
        "apart": (int(apart.max()), float(np.mean(apart > 0))),
    }


def _look(
    sensor: Sensor, surface: SurfaceState, *, samples: int, count: int
) -> tuple[Callable[..., TactileRenderer], FloatArray, FloatArray]:
    """Return what makes a renderer, heights at rest and dents, shape [count, height, width] [m]."""
    geometry = sensor.camera
    maps = height_maps(surface, geometry.refined(samples), pad=sensor.pad)
    grey = np.full((geometry.height, geometry.width, 3), _GREY, dtype=np.uint8)
    renderer = partial(
        TactileRenderer,
        grey,
        maps.rest,
        _as_wide_as_fitted(sensor),
        geometry,
        samples=samples,
        blur_px=BLUR_PX,
        shadows=sensor.optics.shadows,
    )
    depths = np.arange(1, count + 1) / count
    return renderer, maps.rest, depths[:, None, None] * (maps.rest - maps.loaded)


def _with_markers(
    sensor: Sensor, surface: SurfaceState, bare: Callable[[], ImageArray]
) -> tuple[Callable[[], ImageArray], int]:
    """Return what prints a sensor's markers over an image as well, and how many there are."""
    geometry, grid = sensor.camera, sensor.markers
    if grid is None:
        return bare, 0
    even, places = (
        np.full((geometry.height, geometry.width, 3), _GREY, np.uint8),
        marker_places(grid),
    )
    found = find_markers(draw_markers(even, places, grid.radius_m, geometry))
    if found is None:
        return bare, 0
    printer = MarkerPrinter(surface.top, found, geometry)
    return lambda: printer.image_over(bare(), surface), len(places)


def _as_wide_as_fitted(sensor: Sensor) -> PhotometricModel:
    """Return nominal colours with all the terms that a calibration fits to ball presses."""
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
    near = [(lamp.azimuth_rad, lamp.elevation_rad) for lamp in lamps]
    shading = ShadingTerms(
        lamps=tuple(NearLamp(azimuth_rad=a, elevation_rad=e, distance=1.6) for a, e in near),
        softness=0.1,
        aspect=sensor.camera.height / sensor.camera.width,
        crease_limit=3e3,
    )
    colours = [0.2 * np.array(lamp.colour) for lamp in lamps]
    places = np.array([1.0, 0.1, -0.1])  # level and gradients over the image
    weights = places[:, None] * np.stack([*colours, np.full(3, 5.0)])[:, None]
    wide = replace(model, exponents=BALL_EXPONENTS, coefficients=coefficients)
    return replace(wide, terms=shading, term_coefficients=weights.reshape(-1, 3))


def times_of(act: Callable[[], object], *, budget_s: float) -> list[float]:
    """Repeat something after once to warm up, and return how long each time took [s].

    No repeat begins once the budget was spent, but for the least number of them.
    """
    act()
    times: list[float] = []
    while len(times) < _REPEATS and (len(times) < _REPEATS_LEAST or sum(times) < budget_s):
        started = time.perf_counter()
        act()
        times.append(time.perf_counter() - started)
    return times
