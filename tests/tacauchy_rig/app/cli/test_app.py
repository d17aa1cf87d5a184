"""The program as a process: exit codes and messages, and help that imports nothing heavy."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tacauchy_rig.app.cli.app import COMMANDS, PANELS, Group, app, foreseen
from tacauchy_rig.core.config.load import example_text
from tacauchy_rig.core.errors import AbortedError

ROOT = Path(__file__).resolve().parents[4]


def call(*arguments: str, cwd: Path, stdin: str = "") -> subprocess.CompletedProcess[str]:
    """Run ``tacauchy-rig`` as an operator does."""
    return subprocess.run(
        [sys.executable, "-m", "tacauchy_rig.app.cli.app", *arguments],
        cwd=cwd,
        input=stdin,
        capture_output=True,
        text=True,
        timeout=100,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )


def test_an_error_is_two_lines_and_status_2(tmp_path: Path) -> None:
    """No traceback reaches a person who did not ask for it."""
    done = call("report", "nowhere", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("error: nowhere: not a run folder")
    assert "->" in done.stderr
    assert "Traceback" not in done.stderr


def test_debug_shows_the_traceback(tmp_path: Path) -> None:
    """``--debug`` is for those who want it."""
    done = call("--debug", "report", "nowhere", cwd=tmp_path)
    assert done.returncode != 0
    assert "Traceback" in done.stderr


def test_unknown_key_names_field_and_remedy(tmp_path: Path) -> None:
    """A misspelt key is refused before anything is made."""
    (tmp_path / "rig.toml").write_text('[robot]\npress_spead = "0.2 mm/s"\n')
    done = call("run", "rig.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert "robot.press_spead" in done.stderr
    assert not (tmp_path / "runs").exists()


FILLED_IN = [
    "--set=robot.host=127.0.0.99",
    "--set=robot.connect_timeout=2 s",
    "--set=force_sensor.port=/dev/ttyUSB77",
    "--set=force_sensor.calibration_sheet=no. 7 of 2026-01-01",
    "--set=sensor.optics_calibration=",
]
"""The example's labels, read at a rig where nothing is plugged in."""
SMALL = ["--set=camera.width=320", "--set=camera.height=240"]  # for a disk with little room


def test_what_is_missing_is_told_before_a_word_is_asked_for(tmp_path: Path) -> None:
    """Every device at once, each with its remedy; no run folder is begun."""
    assert call("config", "example", "rig.toml", cwd=tmp_path).returncode == 0
    done = call("run", "rig.toml", *FILLED_IN, cwd=tmp_path, stdin="gelsight-mini\n")
    assert done.returncode == 2
    for name in ("robot 127.0.0.99", "/dev/ttyUSB77", "camera: no camera matches"):
        assert name in done.stderr
    assert done.stderr.count("->") == 3
    assert "Type the sensor's name" not in done.stdout
    assert not (tmp_path / "runs").exists()


def test_nothing_moves_without_the_sensors_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A real arm's run shows what will move and stops at a wrong answer, with status 3."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tacauchy_rig.app.cli.run_and_resume.require_devices", lambda _: None)
    (tmp_path / "rig.toml").write_text(example_text())
    unchecked = ["--set=limits.allow_unchecked_force=true", *SMALL]
    done = CliRunner().invoke(app, ["run", "rig.toml", *FILLED_IN, *unchecked], input="yes\n")
    assert isinstance(done.exception, AbortedError)
    assert done.exception.exit_code == 3
    assert "nothing moved" in done.exception.message


@pytest.mark.parametrize(
    ("error", "message", "remedy"),
    [
        (MemoryError("Unable to allocate 8 GiB"), "out of memory: Unable", "ulimit -v"),
        (OSError(errno.EMFILE, "Too many open files"), "too many open files", "ulimit -n"),
        (
            OSError(errno.EROFS, "Read-only", "/a/b"),
            "/a/b: its disk is read-only",
            "output_directory",
        ),
        (OSError(errno.ENOSPC, "No space", "/a/b"), "/a/b: no space left", "free some space"),
        (ValueError("odd"), "ValueError: odd", "fault of the program"),
    ],
)
def test_what_the_computer_refuses_is_no_fault_of_the_program(
    error: Exception, message: str, remedy: str
) -> None:
    """Memory, files and disks have their own words; the rest is called what it is."""
    told = foreseen(error)
    assert told.message.startswith(message)
    assert remedy in told.remedy


def test_the_help_lists_few_commands_below_headings() -> None:
    """At most twenty, each once."""
    assert len(COMMANDS) == sum(map(len, PANELS.values())) <= 20
    shown = CliRunner().invoke(app, ["--help"]).output
    assert shown.index("At the rig") < shown.index("Runs") < shown.index("Studies")


GROUPS = {name: each for name, each in COMMANDS.items() if isinstance(each, Group)}


@pytest.mark.parametrize(
    "path",
    [
        *((name,) for name in COMMANDS.keys() - GROUPS.keys()),
        *((group, name) for group in GROUPS for name in GROUPS[group].places),
    ],
)
def test_every_command_has_an_example(path: tuple[str, ...]) -> None:
    """Its help ends with a command that can be typed as it stands."""
    shown = CliRunner().invoke(app, [*path, "--help"]).output
    assert f"Example: tacauchy-rig {' '.join(path)}" in " ".join(shown.split())


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_whole_on_a_terminal_of_80_columns(command: str) -> None:
    """No word of an option's help is cut."""
    shown = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "80"})
    assert shown.exit_code == 0
    assert max(map(len, shown.output.splitlines())) <= 80
    assert "…" not in shown.output


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
import sim.press
from tacauchy_rig.app.cli.app import app
sim.press.press = None
words = "press --sensor gelsight-mini --indenter sphere:diameter=8mm --depth 0.5mm --tolerance 5%"
try:
    app(words.split(), standalone_mode=False)
except TypeError:
    pass
loaded = [name for name in {UNUSED!r} if name in sys.modules]
assert not loaded, f"a press imports {{loaded}}"
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
