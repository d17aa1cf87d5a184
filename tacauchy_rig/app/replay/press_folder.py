"""A press of the command line on disk: everything that a replay writes, and what it is made of."""

from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from sim.effects.effect_choice import plan_effects
from sim.effects.press_with_effects import path_for
from sim.fields.saved_press import TrialFields, gel_vtu, indenter_vtu, passed_states, trial_fields
from sim.mesh.elements import linear_facets
from sim.optics.height.height_map import HeightMaps, height_maps
from sim.optics.markers.simulated_markers import draw_markers, marker_places, surface_displacement
from sim.press import PressResult
from sim.scene.scene import Scene
from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.replay.chosen_optics import OpticalCalibration, optics_and_frame
from tacauchy_rig.app.replay.rendering import height_arrays, image_of
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.plot_style import FRAMED_STYLE, PAGE_IN, save_figure
from tacauchy_rig.core.store.atomic_write import write_atomically
from tacauchy_rig.core.store.run_store import ReplayFields, pack_arrays, write_fields

_MM, _KPA = 1e3, 1e-3
STATES_NAME = "states.npz"
# Half the width of the maps over the contact's radius.
_REACH = 1.6


def optics_for(
    scene: Scene, calibration: str, background: Path | None
) -> tuple[OpticalCalibration, ImageArray]:
    """Return how images of a sensor's press are made: its optics, and the no-contact frame.

    Args:
        calibration: A file of ``calibrate optics``; empty takes the lamps of the sensor's file.
        background: The no-contact frame; None is evenly grey with the markers of that file.

    Raises:
        ConfigError: A file is missing or of another size, or the sensor's file names no lamps.
    """
    sensor, given = load_sensor(scene.sensor), Path(calibration) if calibration else None
    optics, frame = optics_and_frame(sensor, given, background)
    if background is None and sensor.markers is not None:
        places = marker_places(sensor.markers)
        frame = draw_markers(frame, places, sensor.markers.radius_m, optics.geometry)
    return optics, frame


def write_press(
    folder: Path,
    scene: Scene,
    result: PressResult,
    optics: tuple[OpticalCalibration, ImageArray] | None,
) -> list[Path]:
    """Write fields, whole gel, indenter and figure; of a sensor image, height map and markers too.

    Args:
        optics: As of ``optics_for``; None for a bare pad.

    Returns:
        The files.

    Raises:
        RecordError: A file cannot be written.
    """
    path = path_for(scene, plan_effects(scene), model=result.model)
    fields = trial_fields(path, result.point)
    seen, kept = None, ReplayFields(fields=fields.arrays, surface_vtu=fields.surface_vtu)
    if optics is not None:
        sensor, (calibration, unloaded) = load_sensor(scene.sensor), optics
        seen = height_maps(fields.surface, calibration.geometry, pad=sensor.pad)
        arrays = fields.arrays
        if sensor.markers is not None:
            places = marker_places(sensor.markers)
            moved = surface_displacement(fields.surface, places)[:, :2]
            arrays |= {"marker_rest_m": places, "marker_displacement_m": moved}
        kept = replace(
            kept,
            fields=arrays,
            height=height_arrays(seen),
            image=image_of(fields.surface, sensor, calibration, unloaded=unloaded),
        )
    write_fields(folder, kept)
    write_atomically(folder / "gel.vtu", gel_vtu(result.model, result.point))
    write_atomically(folder / "indenter.vtu", indenter_vtu(fields.surface))
    if result.way is not None:
        density = np.array(scene.materials[-1].density_kg_m3)
        about = {"sensor": np.array(scene.sensor), "density_kg_m3": density}
        states = pack_arrays({**passed_states(result.way), **about})
        write_atomically(folder / STATES_NAME, states)
    with mpl.rc_context(FRAMED_STYLE):
        save_figure(_figure(fields, result, seen, kept.image), folder, "figure")
    return sorted(path for path in folder.iterdir() if path.is_file())


def _figure(
    fields: TrialFields, result: PressResult, seen: HeightMaps | None, image: ImageArray | None
) -> Figure:
    """Return pressure and shear over the contact, and what the camera sees."""
    arrays = fields.arrays
    parts = 2 if seen is None else 4
    figure = Figure(figsize=(PAGE_IN, 2.2), layout="constrained")
    row = figure.subplots(1, parts)
    points = arrays["node_m"][:, :2] * _MM
    plan = Triangulation(points[:, 0], points[:, 1], linear_facets(arrays["faces"]))
    shear = np.linalg.norm(arrays["contact_shear_pa"], axis=1)
    named = (("$-p_n$ (kPa)", arrays["contact_pressure_pa"]), (r"$|t_\tau|$ (kPa)", shear))
    tip, reach = arrays["indenter_tip_m"] * _MM, _REACH * result.contact_radius_m * _MM
    for axes, (name, values) in zip(row, named, strict=False):
        most = max(float(values.max()) * _KPA, 1e-9)
        shown = axes.tripcolor(plan, values * _KPA, shading="gouraud", cmap="cividis", vmax=most)
        axes.set(title=name, aspect="equal", xlabel="$x$ (mm)")
        axes.set(xlim=(tip[0] - reach, tip[0] + reach), ylim=(tip[1] - reach, tip[1] + reach))
        figure.colorbar(shown, ax=axes, shrink=0.8)
    if seen is not None and image is not None:
        shown = row[2].imshow((seen.rest - seen.loaded) * _MM, cmap="cividis")
        row[2].set(title="indented (mm)", xticks=[], yticks=[])
        figure.colorbar(shown, ax=row[2], shrink=0.8)
        row[3].imshow(image)
        row[3].set(title="image", xticks=[], yticks=[])
    return figure
