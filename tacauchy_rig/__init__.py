"""From a recorded press on a tactile sensor to a replay matched in force and an honest report.

Everything that a notebook or another program needs is imported from here::

    from tacauchy_rig import Sphere, Target, load_sensor, press

    result = press(load_sensor("gelsight-mini").scene(Sphere(diameter_m=8e-3), Target(force_n=1.0)))

A name is imported when it is first used: ``import tacauchy_rig`` alone loads no simulator. Modules
behind these names may move from one version to the next. All values are in SI units.
"""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from reports.scores.floors import trial_floors as trial_floors
    from reports.scores.metrics import score as score
    from sim.batch.batch import Batch as Batch
    from sim.batch.environment import Environment as Environment
    from sim.batch.environment import Trajectory as Trajectory
    from sim.batch.pilot import Pilot as Pilot
    from sim.batch.pilot import batch_model as batch_model
    from sim.batch.sensor_batch import SensorBatch as SensorBatch
    from sim.batch.sensor_batch import sensor_model as sensor_model
    from sim.effects.plan import plan_effects as plan_effects
    from sim.fields.contact_traction import surface_traction as surface_traction
    from sim.press import PressResult as PressResult
    from sim.press import press as press
    from sim.press_command import scene_from as scene_from
    from sim.scene.indenter import Cylinder as Cylinder
    from sim.scene.indenter import Plane as Plane
    from sim.scene.indenter import Sphere as Sphere
    from sim.scene.indenter import read_mesh_indenter as read_mesh_indenter
    from sim.scene.scene import ContactMode as ContactMode
    from sim.scene.scene import Effect as Effect
    from sim.scene.scene import Motion as Motion
    from sim.scene.scene import Preset as Preset
    from sim.scene.scene import Scene as Scene
    from sim.scene.scene import Target as Target
    from sim.sensor.sensor import Sensor as Sensor
    from sim.sensor.sensor import load_sensor as load_sensor
    from tacauchy_rig.app.replay.opening import open_run as open_run
    from tacauchy_rig.app.replay.rendering import image_of as image_of
    from tacauchy_rig.app.replay.replay import replay_run as replay  # noqa: F401
    from tacauchy_rig.app.replay.report import evidence_of as evidence_of
    from tacauchy_rig.app.replay.report import report_run as report  # noqa: F401
    from tacauchy_rig.core.config.load import load_config as load_config
    from tacauchy_rig.core.errors import RigError as RigError

__version__ = "0.1.0"


def _public_names() -> dict[str, tuple[str, str]]:
    """Return of each name that is imported above its module and its name there."""
    tree = ast.parse(Path(__file__).read_text("utf-8"))
    imports = (each for each in ast.walk(tree) if isinstance(each, ast.ImportFrom))
    return {
        name.asname: (each.module or "", name.name)
        for each in imports
        for name in each.names
        if name.asname
    }


_PUBLIC = _public_names()

__all__ = ["__version__", *_PUBLIC]  # noqa: PLE0604 - names of the table


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _PUBLIC:
        raise AttributeError(f"module 'tacauchy_rig' has no attribute {name!r}")
    module, attribute = _PUBLIC[name]
    value = globals()[name] = getattr(import_module(module), attribute)
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
