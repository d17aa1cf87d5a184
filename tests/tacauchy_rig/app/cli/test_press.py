"""What ``press`` says besides numbers, and the options of its scene."""

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from sim.optics.calibrate.ball_press import read_rgb
from sim.scene.material import LawName
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.app.cli.output import documented
from tacauchy_rig.app.cli.press import StatedScene
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.image_codec import encode_png

DISC = ("--pad", "disc:radius=6mm,height=2mm", "--young", "0.43MPa", "--poisson", "0.45")
PRESS = ("--indenter", "sphere:diameter=4mm", "--depth", "0.05mm", "--preset", "fast")


def test_printed_law_warns_of_its_stress_at_rest() -> None:
    """The paper's Eq. 4 is run, with the tension and the shrinkage it brings named."""
    done = CliRunner().invoke(app, ["press", *DISC, *PRESS, "--law", "paper-eq4"])
    assert done.exit_code == 0
    assert "tension of 148.3 kPa at rest" in done.stderr
    assert "shrink by 4.0% per axis" in done.stderr
    assert "force" in done.stdout


def test_gel_that_is_inside_out_is_told() -> None:
    """A bonded rim half way through a compressible pad crushes the elements at its edge."""
    bonded = ["--indenter", "cylinder:diameter=3mm,fillet=0.1mm", "--contact", "bonded"]
    deep = [*bonded, "--depth", "1mm", "--preset", "fast", "--no-estimate-error"]
    done = CliRunner().invoke(app, ["press", *DISC[:-1], "0.3", *deep])
    assert done.exit_code == 0
    assert "inside out somewhere (det F -" in done.stderr
    usual = CliRunner().invoke(app, ["press", *DISC, *PRESS, "--no-estimate-error"])
    assert "inside out" not in usual.stderr


def test_every_output_has_an_error_unless_that_is_refused(tmp_path: Path) -> None:
    """A bonded press is pressed again on longer edges."""
    bonded = ["press", *DISC, *PRESS, "--contact", "bonded"]
    file = tmp_path / "press.json"
    done = CliRunner().invoke(app, [*bonded, "--json", str(file)])
    assert done.exit_code == 0
    assert "Richardson" in done.stdout
    found = json.loads(file.read_text("utf-8"))
    assert 0.0 < found["estimated_force_error_relative"] < 0.5
    assert {"force", "pressure", "shear", "image", "markers"} == set(found["estimated_errors"])
    assert "errors     pressure " in done.stdout
    assert found["surface_traction_gap_relative"] > 0.0
    assert "not known" in CliRunner().invoke(app, [*bonded, "--no-estimate-error"]).stdout


def test_tolerance_chooses_the_preset(tmp_path: Path) -> None:
    """A wide one takes the cheapest; the neighbours' cost is printed and kept."""
    scene = ["press", *DISC, *PRESS[:4]]
    file = tmp_path / "press.json"
    done = CliRunner().invoke(app, [*scene, "--tolerance", "20%", "--json", str(file)])
    assert done.exit_code == 0
    assert done.stdout.splitlines()[0].endswith("preset fast, load-step edges 2 times as long")
    assert "force at 0.05 mm: estimated error" in done.stdout
    assert "cost       " in done.stdout
    assert "better     preset fast, edges 0.714 times as long, load-step edges" in done.stdout
    found = json.loads(file.read_text("utf-8"))
    assert found["preset"] == "fast, load-step edges 2 times as long"
    assert found["guaranteed"] == "force"
    assert found["guaranteed_error_relative"] == found["corrected"]["error_relative"] <= 0.2
    assert found["corrected"]["force_n"] < found["force_n"][2]
    assert found["corrected"]["depth_m"] == found["depth_m"]
    assert found["alternatives"][-1]["time_ratio"] > 1.0
    raw, corrected = found["force_n"][2], found["corrected"]["force_n"]
    assert f"corrected  {corrected:.4f} N at 0.0500 mm" in done.stdout
    assert f"raw        {raw:.4f} N at 0.0500 mm" in done.stdout


def test_a_plan_states_tolerances_cost_and_neighbours(tmp_path: Path) -> None:
    """Before the press: what each output may lose, the time over preset fast's, and both sides."""
    file = tmp_path / "plan.json"
    scene = ["plan", *DISC, *PRESS[:4], "--preset", "balanced", "--json", str(file)]
    done = CliRunner().invoke(app, scene)
    assert done.exit_code == 0
    for line in ("allowed of force", "trying took", "cost       about", "cheaper    ", "better  "):
        assert line in done.stdout
    between = CliRunner().invoke(app, ["plan", *DISC, *PRESS[:4], "--tolerance", "1%"])
    assert "preset: fast, edges 0.714 times as long, load-step edges 2 times" in between.stdout
    found = json.loads(file.read_text("utf-8"))
    assert found["tolerances"]["force"] == 0.02
    assert found["time_over_fast"] > 1.0
    assert {other["role"] for other in found["alternatives"]} == {"cheaper", "better"}
    assert {other["wall_s"] for other in found["alternatives"]} == {None}


@pytest.mark.parametrize("share", [0.05, 0.02])
def test_a_press_that_remembers_its_way_has_a_mesh_for_its_raw_force(
    share: float, tmp_path: Path
) -> None:
    """Nothing is corrected of a quick press; an error that is still above the tolerance is told."""
    file, quick = tmp_path / "press.json", ["--depth", "0.4mm", "--duration", "3ms"]
    scene = ["press", "--sensor", "gelsight-mini", "--indenter", "sphere:diameter=8mm", *quick]
    done = CliRunner().invoke(app, [*scene, "--tolerance", f"{share:%}", "--json", str(file)])
    found = json.loads(file.read_text("utf-8"))
    assert found["corrected"] is None
    assert "load-step edges" not in done.stdout
    error, others = found["guaranteed_error_relative"], found["alternatives"]
    assert ("above the tolerance" in done.stderr) is (error > share)
    assert 0.5 * share < others[1]["error_relative"] < error < 1.2 * share


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (("--force", "-1N"), "--force -1N is negative"),
        (("--depth", "-0.2mm"), "--depth -0.2mm is negative"),
        (("--depth", "2mm"), "--depth of 2 mm goes through a gel that is 2 mm thick"),
        (("--depth", "0.3cm"), "--depth of 3 mm goes through a gel that is 2 mm thick"),
        (("--depth", "1mm", "--tolerance", "1 mm"), '--tolerance: "1 mm" is no tolerance'),
    ],
)
@pytest.mark.parametrize("command", ["press", "plan"])
def test_what_no_press_can_reach_or_keep_is_refused(
    command: str, target: tuple[str, ...], message: str
) -> None:
    """Nothing is simulated; the option is named, and lengths are in millimetres."""
    refused = CliRunner().invoke(app, [command, *DISC, *PRESS[:2], *target])
    assert isinstance(refused.exception, ConfigError)
    assert refused.exception.message == message
    assert refused.exception.remedy
    if target[1].startswith("-"):
        assert refused.exception.remedy.endswith(f"{target[0]} {target[1][1:]}")


def test_a_plan_takes_the_way_to_a_force() -> None:
    """What was given to ``press`` can be given to ``plan``; another way is refused by name."""
    scene = ["plan", *DISC, *PRESS[:2], "--force", "0.1N"]
    assert CliRunner().invoke(app, [*scene, "--drive", "search"]).exit_code == 0
    refused = CliRunner().invoke(app, [*scene, "--drive", "push"])
    assert refused.exit_code == 2
    assert "--drive" in refused.stderr


def test_out_writes_what_a_replay_writes(tmp_path: Path) -> None:
    """Of a sensor image, heights and markers too; a bare pad has no camera, and says so.

    Where the gel is not moved, the image is the no-contact frame that was given.
    """
    folder, background = tmp_path / "found", tmp_path / "rest.png"
    frame = np.broadcast_to(np.arange(240)[:, None, None] // 2 + 40, (240, 320, 3)).astype(np.uint8)
    background.write_bytes(encode_png(frame))
    sensor = ["press", "--sensor", "gelsight-mini", *PRESS, "--out", str(folder)]
    sensor += ["--background", str(background)]
    assert CliRunner().invoke(app, sensor).exit_code == 0
    image = read_rgb(folder / "image.png")
    np.testing.assert_array_equal(image[:, 0], frame[:, 0])
    assert (image != frame).any()
    always = {"press.json", "fields.npz", "surface.vtu", "gel.vtu", "indenter.vtu", "figure.png"}
    always |= {"states.npz"}
    written = {path.name for path in folder.iterdir()}
    assert written == always | {"figure.pdf", "image.png", "height.npz"}
    with np.load(folder / "fields.npz") as fields:
        assert fields["cauchy_stress_pa"].shape == (len(fields["node_m"]), 6)
        assert fields["marker_displacement_m"].shape == (63, 2)
        pressed = fields["contact_pressure_pa"] > 0.0
        assert fields["contact_pressure_error_pa"][pressed].max() > 0.0
    bare = CliRunner().invoke(app, ["press", *DISC, *PRESS, "--out", str(tmp_path / "bare")])
    assert "a bare pad has no camera" in bare.stdout
    assert {path.name for path in (tmp_path / "bare").iterdir()} == always | {"figure.pdf"}
    refused = CliRunner().invoke(app, ["press", *DISC, *PRESS, "--background", str(background)])
    assert isinstance(refused.exception, ConfigError)


GIVEN = ("--indenter", "plane", "--law", "linear", "--layer", "a", "--layer", "b", "--twice", "3")


def test_a_command_gets_the_scenes_options_and_its_own() -> None:
    """What was given arrives as the scene's terms, what was not has its default."""
    seen: list[tuple[StatedScene, int]] = []

    def command(terms: StatedScene, twice: Annotated[int, typer.Option("--twice")] = 1) -> None:
        """Note what it is called with."""
        seen.append((terms, 2 * twice))

    app = typer.Typer()
    app.command()(documented(command))
    assert CliRunner().invoke(app, list(GIVEN)).exit_code == 0
    terms = StatedScene(indenter="plane", law=LawName.LINEAR, layer=["a", "b"])
    assert seen == [(terms, 6)]
    assert CliRunner().invoke(app, ["--twice", "3"]).exit_code == 2
