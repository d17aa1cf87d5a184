"""Record presses on a tactile sensor, simulate them at the measured forces, and report both.

Everything that a notebook or another program needs is imported from here::

    from tacauchy_rig import Sphere, Target, load_sensor, press

    result = press(load_sensor("gelsight-mini").scene(Sphere(diameter_m=8e-3), Target(force_n=1.0)))

A name is imported when it is first used: ``import tacauchy_rig`` alone loads no simulator. Modules
behind these names may move from one version to the next. All values are in SI units.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from reports.scores.image_metrics import score as score
    from reports.scores.image_metrics import trial_floors as trial_floors
    from sim.batch.batch import Batch as Batch
    from sim.batch.sensor_model import sensor_model as sensor_model
    from sim.effects.effect_choice import plan_effects as plan_effects
    from sim.fields.pressure_and_shear import surface_traction as surface_traction
    from sim.press import PressResult as PressResult
    from sim.press import press as press
    from sim.press_arguments import scene_from as scene_from
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
    from tacauchy_rig.app.replay.open_run import open_run as open_run
    from tacauchy_rig.app.replay.rendering import image_of as image_of
    from tacauchy_rig.app.replay.replay import replay_run as replay  # noqa: F401
    from tacauchy_rig.app.replay.report_run import evidence_of as evidence_of
    from tacauchy_rig.app.replay.report_run import report_run as report  # noqa: F401
    from tacauchy_rig.core.config.load import load_config as load_config
    from tacauchy_rig.core.errors import RigError as RigError

__version__ = "0.1.0"

_PUBLIC = {
    "Batch": "sim.batch.batch:Batch",
    "ContactMode": "sim.scene.scene:ContactMode",
    "Cylinder": "sim.scene.indenter:Cylinder",
    "Effect": "sim.scene.scene:Effect",
    "evidence_of": "tacauchy_rig.app.replay.report_run:evidence_of",
    "image_of": "tacauchy_rig.app.replay.rendering:image_of",
    "load_config": "tacauchy_rig.core.config.load:load_config",
    "load_sensor": "sim.sensor.sensor:load_sensor",
    "Motion": "sim.scene.scene:Motion",
    "open_run": "tacauchy_rig.app.replay.open_run:open_run",
    "plan_effects": "sim.effects.effect_choice:plan_effects",
    "Plane": "sim.scene.indenter:Plane",
    "Preset": "sim.scene.scene:Preset",
    "press": "sim.press:press",
    "PressResult": "sim.press:PressResult",
    "read_mesh_indenter": "sim.scene.indenter:read_mesh_indenter",
    "replay": "tacauchy_rig.app.replay.replay:replay_run",
    "report": "tacauchy_rig.app.replay.report_run:report_run",
    "RigError": "tacauchy_rig.core.errors:RigError",
    "Scene": "sim.scene.scene:Scene",
    "scene_from": "sim.press_arguments:scene_from",
    "score": "reports.scores.image_metrics:score",
    "Sensor": "sim.sensor.sensor:Sensor",
    "sensor_model": "sim.batch.sensor_model:sensor_model",
    "Sphere": "sim.scene.indenter:Sphere",
    "surface_traction": "sim.fields.pressure_and_shear:surface_traction",
    "Target": "sim.scene.scene:Target",
    "trial_floors": "reports.scores.image_metrics:trial_floors",
}
"""Where each public name is defined, ``module:name``; the imports above say the same."""

__all__ = ["__version__", *_PUBLIC]  # noqa: PLE0604 - names of the table


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _PUBLIC:
        raise AttributeError(f"module 'tacauchy_rig' has no attribute {name!r}")
    module, _, attribute = _PUBLIC[name].partition(":")
    value = globals()[name] = getattr(import_module(module), attribute)
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
