"""A press of the command line on disk: everything that a replay writes, and what it is made of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.fields.press_fields import TrialFields, gel_vtu, indenter_vtu, passed_states, trial_fields
from sim.mesh.elements import linear_facets
from sim.optics.height.height_map import HeightMaps, height_maps
from sim.optics.markers.marker_printer import surface_displacement
from sim.optics.markers.printed_markers import draw_markers, marker_places
from sim.press import PressResult
from sim.scene.scene import Scene
from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.replay.optics import grey_frame, nominal_optics
from tacauchy_rig.app.replay.rendering import height_arrays, image_of
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.figure_style import FRAMED_STYLE, PAGE_IN, save_figure
from tacauchy_rig.core.store.durable import write_atomically
from tacauchy_rig.core.store.run_store import ReplayFields, pack_arrays, write_fields

_MM, _KPA = 1e3, 1e-3
STATES_NAME = "states.npz"
# Half the width of the maps over the contact's radius.
_REACH = 1.6


def write_press(folder: Path, scene: Scene, result: PressResult) -> list[Path]:
    """Write fields, whole gel, indenter and figure; of a sensor image, height map and markers too.

    Returns:
        The files.

    Raises:
        ConfigError: The sensor's file names no lamps.
        RecordError: A file cannot be written.
    """
    path = path_for(scene, plan_effects(scene), model=result.model)
    fields = trial_fields(path, result.point)
    seen, kept = None, ReplayFields(fields=fields.arrays, surface_vtu=fields.surface_vtu)
    if scene.sensor:
        sensor = load_sensor(scene.sensor)
        optics = nominal_optics(sensor)
        seen = height_maps(fields.surface, optics.geometry, pad=sensor.pad)
        even, arrays = grey_frame(optics), fields.arrays
        if sensor.markers is not None:
            places = marker_places(sensor.markers)
            even = draw_markers(even, places, sensor.markers.radius_m, optics.geometry)
            moved = surface_displacement(fields.surface, places)[:, :2]
            arrays |= {"marker_rest_m": places, "marker_displacement_m": moved}
        kept = replace(
            kept,
            fields=arrays,
            height=height_arrays(seen),
            image=image_of(fields.surface, sensor, optics, unloaded=even),
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
