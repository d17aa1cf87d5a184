"""A laboratory's own package adds arm, law, indenter, sensor and renderer.

It is installed beside this one and used from outside the repository, by the command line and by the
public interfaces.
"""

import json
import math
import os
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

from tacauchy_rig.core.config.load import example_text

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "tests" / "outside_package"

_USE_THE_ARM = """
import sys
from pathlib import Path

from drivers.device_checks import robot_checks
from drivers.conformance import ARM_CHECKS, LOCKING_ARM_CHECKS
from drivers.interfaces import build_arm_and_force_sensor
from tacauchy_rig.core.config.load import load_config

config = load_config(Path("rig.toml")).config
assert config.robot.options == {"cycle_hz": 500}
assert config.moves_real_hardware
for check in (*ARM_CHECKS, *LOCKING_ARM_CHECKS):
    check(lambda: build_arm_and_force_sensor(config)[0])
    print(check.__name__)
for result in robot_checks(config):
    print(result.name, result.status.value, result.finding)
"""

_RENDER_A_PRESS = """
from sim.effects.effect_choice import plan_effects
from sim.fields.saved_press import surface_state
from sim.effects.press_with_effects import follow, path_for
from sim.press_arguments import scene_from
from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.replay.rendering import replay_images

scene = scene_from("--sensor press-lab-skin --indenter lab-ball --depth 0.2mm --preset fast")
path = path_for(scene, plan_effects(scene))
surface = surface_state(path, follow(scene, path))
image = replay_images(load_sensor("press-lab-skin"))(surface).astype(int)
print(*image[60, 80], *image[2, 2], (image[..., 2] - image[..., 0]).min(),
      (image[..., 2] - image[..., 0]).max())
"""

_ASK_FOR_WHAT_IS_NOT_THERE = """
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.core.errors import ConfigError

shape = ("--indenter", "plane", "--depth", "0.1mm")
for words in (
    ("press", "--sensor", "press-lab", *shape),
    ("press", "--sensor", "fog.toml", *shape),
    ("config", "show", "--set", "robot.driver=press-lab"),
):
    try:
        app(words, standalone_mode=False)
    except ConfigError as error:
        print(" ".join(f"{error.message} -> {error.remedy}".split()))
"""


@dataclass(frozen=True)
class Laboratory:
    """A folder of somebody else's, with the package installed."""

    folder: Path
    site: Path

    def python(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run Python there."""
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=self.folder,
            env={**os.environ, "PYTHONPATH": f"{self.site}:{ROOT}"},
            capture_output=True,
            text=True,
            timeout=280,
            check=False,
        )

    def rig(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run the command line there."""
        return self.python("-m", "tacauchy_rig.app.cli.app", *arguments)


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Laboratory:
    """Install the package as pip would, without a network: its files and their metadata."""
    folder, site = tmp_path_factory.mktemp("laboratory"), tmp_path_factory.mktemp("site")
    shutil.copytree(
        PACKAGE / "press_lab", site / "press_lab", ignore=shutil.ignore_patterns("__pycache__")
    )
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text("utf-8"))["project"]
    metadata = site / f"press_lab-{project['version']}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n", "utf-8"
    )
    groups = project["entry-points"].items()
    (metadata / "entry_points.txt").write_text(
        "".join(
            f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in entries.items())
            for group, entries in groups
        ),
        "utf-8",
    )
    return Laboratory(folder=folder, site=site)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_its_sensor_law_and_indenter_press(laboratory: Laboratory) -> None:
    """At small strains its law gives the force of the linear one within 2 %, and is another law."""
    forces = {}
    # Without the effect that is asked for, so small a press would be planned with the linear law.
    laws = {"log-neo-hookean": ["--effect", "finite-strain=on"], "linear": []}
    for law, more in laws.items():
        options = ["--sensor", "press-lab-skin", "--indenter", "lab-ball", "--law", law, *more]
        options += ["--depth", "0.02mm", "--preset", "fast", "--no-estimate-error"]
        done = laboratory.rig("press", *options, "--json", f"{law}.json")
        assert done.returncode == 0, done.stdout + done.stderr
        forces[law] = json.loads((laboratory.folder / f"{law}.json").read_text())["force_n"][2]
    assert forces["log-neo-hookean"] > 0.0
    assert forces["log-neo-hookean"] != forces["linear"]
    assert forces["log-neo-hookean"] == pytest.approx(forces["linear"], rel=0.02)


@pytest.mark.timeout(300)
def test_its_arm_conforms_and_is_chosen_in_a_rig_toml(laboratory: Laboratory) -> None:
    """A driver of another package counts as real, and keeps every promise of an arm."""
    text = example_text().replace('driver = "ur5" ', 'driver = "press-lab-arm" ')
    text = text.replace("[force_sensor]", "[robot.options]\ncycle_hz = 500\n\n[force_sensor]")
    text = text.replace("XXXXXXXX", "A50285BI")
    text = text.replace("number and date of the sheet", "no. 7 of 2026-01-01")
    (laboratory.folder / "rig.toml").write_text(text, "utf-8")
    done = laboratory.python("-c", _USE_THE_ARM)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "arm_locks_in_a_protective_stop" in done.stdout
    assert "robot.controller ok arm of the press lab at this process" in done.stdout
    assert "robot.home ok" in done.stdout


@pytest.mark.timeout(300)
def test_its_renderer_makes_the_image_of_a_press(laboratory: Laboratory) -> None:
    """Over grey of 110: 60 (1 - exp(-1)) brighter 0.2 mm deep, blue by the flanks' slopes alone."""
    done = laboratory.python("-c", _RENDER_A_PRESS)
    assert done.returncode == 0, done.stdout + done.stderr
    red, green, blue, *corner, shaded, lit = map(int, done.stdout.split())
    assert red == pytest.approx(110.0 + 60.0 * (1.0 - math.exp(-1.0)), abs=1.0)
    assert green == red == pytest.approx(blue, abs=1.0)
    assert corner == pytest.approx([110, 110, 110], abs=3.0)
    assert -9 < shaded < -1 < 1 < lit < 9


def test_what_is_there_is_named(laboratory: Laboratory) -> None:
    """An unknown name is answered with every known one, those of the package included."""
    sensor = (PACKAGE / "press_lab" / "skin.toml").read_text("utf-8")
    (laboratory.folder / "fog.toml").write_text(sensor.replace("press-lab-haze", "fog"), "utf-8")
    done = laboratory.python("-c", _ASK_FOR_WHAT_IS_NOT_THERE)
    assert done.returncode == 0, done.stderr
    no_sensor, no_renderer, no_driver = done.stdout.splitlines()
    for known in ("9dtact", "digit", "gelsight-mini", "press-lab-skin"):
        assert known in no_sensor
    assert 'fog.toml: optics.kind: renderer "fog" is none of "photometric", "gr' in no_renderer
    assert '"ur5", "emulated", "press-lab-arm"' in no_driver
