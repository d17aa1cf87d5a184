"""Help of every command, at once: nothing heavy is imported for it."""

from __future__ import annotations

import subprocess
import sys

# Each takes a tenth of a second or more, and no help is made with one.
HEAVY = (
    "numpy",
    "warp",
    "scipy",
    "matplotlib",
    "vtk",
    "pyvista",
    "skimage",
    "cv2",
    "pypardiso",
    "mcap",
)
# What a press of an analytic indenter has no use for.
UNUSED = (
    "matplotlib",
    "vtk",
    "pyvista",
    "skimage",
    "scipy.spatial",
    "cv2",
    "pytetwild",
    "jinja2",
    "mcap",
)
SCRIPT = """
import sys
import typer
from tacauchy_rig.app.cli.app import app
commands = typer.main.get_command(app).commands
paths = [[], *([name] for name in commands)]
paths += [[group, name] for group in commands for name in getattr(commands[group], "commands", ())]
for path in paths:
    app([*path, "--help"], standalone_mode=False)
    loaded = [name for name in {heavy!r} if name in sys.modules]
    assert not loaded, f"{{' '.join(path)}} --help imports {{loaded}}"
"""


def test_no_help_imports_what_it_does_not_need() -> None:
    """The program and every command explain themselves without the simulator's libraries."""
    script = SCRIPT.format(heavy=HEAVY)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Usage:") > 30


WRONG_FOLDER = """
import sys
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.core.errors import RecordError
for name in {names!r}:
    try:
        app([name, "nowhere"], standalone_mode=False)
    except RecordError as error:
        assert "not a run folder" in error.message
    else:
        raise AssertionError(f"{{name}} takes any folder")
    loaded = [each for each in {heavy!r} if each in sys.modules]
    assert not loaded, f"{{name}} imports {{loaded}} to refuse a folder"
"""


def test_a_wrong_folder_is_refused_at_once() -> None:
    """What commands on a run work with is imported once there is a run."""
    script = WRONG_FOLDER.format(names=("replay", "report", "recover", "resume"), heavy=HEAVY)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_a_press_imports_no_figures_and_no_images() -> None:
    """Until a press begins, what draws, meshes triangles or handles images is not waited for."""
    script = f"""
import sys
import sim.press, sim.press_command
loaded = [name for name in {UNUSED!r} if name in sys.modules]
assert not loaded, f"a press imports {{loaded}}"
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
