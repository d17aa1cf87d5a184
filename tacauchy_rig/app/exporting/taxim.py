"""A calibration as the tables of Taxim's renderer, which TacEx and Isaac Lab have too.

Si and Yuan, RA-L 2022: colour over the no-contact frame is a quadratic in the pixel's place, one
for each bin of slope (arctan of it, 0 to pi/2) and of its direction (-pi to pi). Ours also knows
indentation, creases and shadows: the tables are those of gel that is not pressed in.
"""

import json
import pprint
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sim.optics.colour.photometric import PhotometricModel
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor, load_sensor
from tacauchy_rig.app.replay.chosen_optics import optics_and_frame
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.image_codec import encode_jpeg

TAXIM_BINS, ISAAC_BINS = 125, 120
_COLUMNS, _ROWS = 9, 7
"""Places in the image at which the quadratics are fitted."""
_HALVED = [0.05 * 0.5**k for k in range(6)]
"""Standard deviations of Taxim's smoothing around a rigid body, over the image's width."""


def write_taxim(source: Path, out: Path, *, sensor: str, background: Path | None) -> None:
    """Write the folder that ``taxim.Taxim(calib_folder=...)`` and TacEx read; it has no shadows.

    Args:
        source: What ``calibrate optics`` wrote, or a sensor's name for its nominal optics.
        sensor: Name of the sensor that was calibrated.
        background: No-contact frame of the scored size; None is an even grey.

    Raises:
        ConfigError: The calibration or the frame is missing, damaged, or of another sensor.
    """
    made, view, model, frame = _opened(source, sensor, background)
    # Its heights are positive towards the camera, and it takes blue for red.
    table = _tables(model, frame, TAXIM_BINS, towards=-1.0)
    colours: dict[str, Any] = {f"grad_{name}": table[..., c] for c, name in enumerate("bgr")}
    np.savez(out / "polycalib.npz", bins=TAXIM_BINS, **colours)
    np.savez(
        out / "dataPack.npz",
        f0=frame[..., ::-1],
        imgs=np.zeros((0, *frame.shape), np.uint8),
        touch_center=np.zeros((0, 2)),
        touch_radius=np.zeros(0),
        img_size=np.array(frame.shape),
    )
    pixel_m = view.mean_scale_m
    columns, rows = np.meshgrid(np.arange(view.width), np.arange(view.height))
    places = view.to_pad(np.stack([columns, rows], axis=-1))
    np.save(out / "gelmap.npy", made.pad.height_at(places[..., 0], places[..., 1]) / pixel_m)
    angles = np.arange(0.0, 2.0 * np.pi, 0.1)
    shadows = np.empty((3, len(angles), 1), dtype=object)
    for at in np.ndindex(shadows.shape):
        shadows[at] = []
    np.savez(out / "shadowTable.npz", shadowDirections=angles, shadowTable=shadows)
    (out / "params.json").write_text(json.dumps(_parameters(view.width, view.height, pixel_m)))


def write_isaaclab(source: Path, out: Path, *, sensor: str, background: Path | None) -> None:
    """Write ``bg.jpg``, ``polycalib.npz`` and the configuration that names them for Isaac Lab.

    Arguments and errors are those of ``write_taxim``.
    """
    made, view, model, frame = _opened(source, sensor, background)
    table = _tables(model, frame, ISAAC_BINS, towards=1.0)
    colours: dict[str, Any] = {f"grad_{name}": table[..., c] for c, name in enumerate("rgb")}
    np.savez(out / "polycalib.npz", **colours)
    (out / "bg.jpg").write_bytes(encode_jpeg(frame, quality=100))
    values = {
        "base_data_path": "FOLDER",
        "sensor_data_dir_name": made.name,
        "image_height": view.height,
        "image_width": view.width,
        "num_bins": ISAAC_BINS,
        "mm_per_pixel": round(1e3 * view.mean_scale_m, 6),
    }
    terms = pprint.pformat(values, sort_dicts=False)
    (out / "render_cfg.py").write_text(
        "from isaaclab_contrib.sensors.tacsl_sensor.visuotactile_sensor_cfg import "
        "GelSightRenderCfg\n\n# FOLDER holds this folder, renamed to sensor_data_dir_name.\n"
        f"RENDER_CFG = GelSightRenderCfg(**{terms})\n"
    )


def _opened(
    source: Path, name: str, background: Path | None
) -> tuple[Sensor, CameraGeometry, PhotometricModel, ImageArray]:
    """Return the sensor, where its pixels look, its colours, and the no-contact frame."""
    is_file = source.suffix == ".npz"
    sensor = load_sensor(name if is_file else str(source))
    optics, frame = optics_and_frame(sensor, source if is_file else None, background)
    if not isinstance(optics.model, PhotometricModel):
        raise ConfigError(
            "this sensor's colour is one of depth, and Taxim's table is one of slope",
            remedy="export a sensor whose optics are photometric, such as gelsight-mini",
        )
    return sensor, optics.geometry, optics.model, frame


def _tables(model: PhotometricModel, frame: ImageArray, bins: int, *, towards: float) -> FloatArray:
    """Return the quadratics' coefficients [grey levels], shape [bins, bins, 6, 3].

    Args:
        towards: -1 where heights are positive towards the camera.
    """
    height, width = frame.shape[:2]
    columns, rows = np.linspace(0, width - 1, _COLUMNS), np.linspace(0, height - 1, _ROWS)
    x, y = np.tile(columns, _ROWS), np.repeat(rows, _COLUMNS)
    fit = np.linalg.pinv(np.column_stack([x * x, y * y, x * y, x, y, np.ones(len(x))]))
    small = cv2.resize(frame, (_COLUMNS, _ROWS), interpolation=cv2.INTER_AREA)
    levels = small.reshape(-1, 3).T.astype(np.float64)
    light = model.response.light(levels)
    slopes = 0.5 * np.pi * np.minimum((np.arange(bins) + 0.5) / (bins - 1), 1.0)
    slopes[0] = 0.0  # level gel is the frame itself
    turns = 2.0 * np.pi * (np.arange(bins) + 0.5) / (bins - 1) - np.pi
    position = np.stack([2.0 * x / (width - 1) - 1.0, 2.0 * y / (height - 1) - 1.0])
    found = np.empty((bins, bins, 6, 3))
    for k, slope in enumerate(slopes):
        tilt = towards * np.sin(slope) * np.array([np.cos(turns), np.sin(turns)])
        everywhere = np.repeat(tilt, len(x), axis=1), np.tile(position, bins)
        change = model.evaluate(*everywhere, np.zeros(bins * len(x))).reshape(3, bins, len(x))
        shown = model.response.levels(light[:, None] + model.gain(light)[:, None] * change)
        found[k] = np.einsum("ap,cbp->bac", fit, shown - levels[:, None])
    return found


def _parameters(width: int, height: int, pixel_m: float) -> dict[str, dict[str, object]]:
    """Return what Taxim needs to know; lengths ending in ``rel`` are over width and height."""

    def both(shares: list[float]) -> list[list[float]]:
        return [shares, [share * width / height for share in shares]]

    def one(share: float) -> list[float]:
        return [share, share * width / height]

    return {
        "simulator": {
            "initial_frame_sigma_rel": one(0.05),
            "frame_mixing_percentage": 0.0,  # the frame as it is
            "diff_threshold": 5,
            "contact_scale": 0.4,
            "deform_pyramid_sigma_rel": both(_HALVED),
            "deform_final_sigma_rel": one(_HALVED[-1]),
            "shadow_step_rel": one(0.002),
            "shadow_blur_sigma_rel": one(_HALVED[-1]),
            "shadow_attachment_kernel_size_rel": one(0.008),
            "discretize_precision": 0.1,
            "height_precision": 0.1,
            "fan_angle": 0.1,
            "fan_precision": 0.05,
        },
        "sensor": {"pixmm": 1e3 * pixel_m, "num_bins": TAXIM_BINS, "w": width, "h": height},
    }
