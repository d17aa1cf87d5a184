"""What the command line asks of the operator's page, and ``emulate fault`` and ``presses``."""

import json
import socket
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from drivers.emulators.faults import FAULTS_OF_DEVICE, Device, FaultKind
from drivers.emulators.process import DeviceSettings, Service
from tacauchy_rig.app.cli import run_and_resume
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.app.cli.live_viewing import contact_outline, told_of_errors, viewers_of
from tacauchy_rig.app.cli.run_and_resume import Request
from tacauchy_rig.app.viewers import foxglove_options as options
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import ConfigError, RigError
from tests.recorded_run import empty_run


@pytest.mark.parametrize(
    ("said", "port"), [("off", None), ("auto", 0), ("1", 1), ("8765", 8765), ("65535", 65535)]
)
def test_a_page_is_left_out_or_has_a_port(said, port):
    """A number is a port."""
    assert Request(page=said).page_port == port


@pytest.mark.parametrize("said", ["0", "65536", "on", "-1", "80.5", ""])
@pytest.mark.parametrize("option", ["page", "foxglove"])
def test_what_is_no_port_is_refused(option, said):
    """With what to give instead, by the option."""
    with pytest.raises(ConfigError, match=f"--{option} .*no port") as caught:
        Request(**{option: said})
    assert "off" in caught.value.remedy


def test_the_outline_lies_where_the_sensors_file_says():
    """In a frame's middle, as large as the flat face; it goes with frame, offset and ball."""
    outline, large, moved, ball = (
        contact_outline(load_config(None, overrides=overrides).config)
        for overrides in (
            [],
            ["camera.width=3280", "camera.height=2464"],
            ['replay.offset=["1 mm", "0 mm"]'],
            ['indenter.kind="sphere"', 'indenter.diameter="6 mm"'],
        )
    )
    assert outline["centre_px"] == pytest.approx((319.5, 239.5))
    assert outline["flat_radius_m"] == pytest.approx(2.4e-3)
    # A sixth of the frame's width is cut off in all; 0.0634 mm is a pixel of 320 across the rest.
    assert outline["scale_px_m"][0] == pytest.approx(0.7 * 640 / 320 / 0.0634e-3, rel=1e-3)
    assert large["scale_px_m"][0] / outline["scale_px_m"][0] == pytest.approx(3280 / 640)
    aside_px = abs(moved["centre_px"][0] - outline["centre_px"][0])
    assert aside_px == pytest.approx(1e-3 * outline["scale_px_m"][0])
    assert (ball["flat_radius_m"], ball["ball_radius_m"]) == (0.0, pytest.approx(3e-3))


@pytest.mark.parametrize("option", ["page", "foxglove"])
def test_a_taken_port_is_told_before_anything_starts(tmp_path: Path, option: str) -> None:
    """By the option that asked for it."""
    store = empty_run(tmp_path)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        request = Request(**{"page": "off", option: str(taken.getsockname()[1])})
        with pytest.raises(ConfigError, match=f"--{option}"):
            run_and_resume.press(store, store.config, request)
    assert not store.paths.truth.exists()


def test_a_missing_package_is_told_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything starts."""
    monkeypatch.setattr(options, "find_spec", lambda _name: None)
    with pytest.raises(ConfigError, match="foxglove-sdk") as caught:
        viewers_of(foxglove=8765)
    assert "tacauchy-rig[foxglove]" in caught.value.remedy


def test_the_twin_is_shown_where_both_are_wanted() -> None:
    """Each is a viewer of its own; the live one names the twin as its source."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    viewers = viewers_of(twin="force", foxglove=port)
    assert [viewer.name for viewer in viewers] == ["twin", "foxglove"]
    assert viewers[1].sources == ("twin",)


class ToldPage:
    """A page that was kept after a run."""

    def __init__(self) -> None:
        self.told: list[tuple[str, str]] = []
        self.released = 0

    def tell_page(self, state: str, text: str, *, passed: bool | None = None) -> None:
        """Keep what it is told."""
        del passed
        self.told.append((state, text))

    def release(self) -> None:
        """Count."""
        self.released += 1


def fail(page: ToldPage) -> None:
    """Analyse in vain."""
    with told_of_errors(page):  # type: ignore[arg-type]
        raise RigError("F_z cannot be reached", remedy="press less")


def test_a_page_is_told_that_a_run_could_not_be_analysed_and_is_let_go() -> None:
    """With the error that the terminal shows; an exit code is no error."""
    page = ToldPage()
    with pytest.raises(RigError):
        fail(page)
    assert [state for state, _ in page.told] == ["analysing", "failed"]
    assert "cannot be reached" in page.told[-1][1]
    with pytest.raises(typer.Exit), told_of_errors(page):  # type: ignore[arg-type]
        raise typer.Exit(1)
    assert page.told[-1][0] == "analysing"
    assert page.released == 2


def _run(*words: object) -> str:
    result = CliRunner().invoke(app, ["emulate", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_a_running_device_is_told_of_a_fault(tmp_path: Path) -> None:
    """It hears what was told, which is written as JSON; a fault that nobody knows is refused."""
    service = Service(
        DeviceSettings(folder=tmp_path, config=load_config().config), Device.FORCE_SENSOR
    )
    words = ["--json", tmp_path / "told.json"]
    try:
        _run("fault", tmp_path, "force_sensor:freeze@1s+2s", *words)
        assert service.faults_at(0.0) == []
        (heard,) = service.faults_at(1.0)
    finally:
        service.close()
    assert (heard.kind, heard.start_s, heard.duration_s) == (FaultKind.FREEZE, 1.0, 2.0)
    assert json.loads((tmp_path / "told.json").read_text())["fault"] == "force_sensor:freeze@1s+2s"
    with pytest.raises(ConfigError, match="melt"):
        _run("fault", tmp_path, "force_sensor:melt@1s")


def test_the_help_names_every_kind() -> None:
    """An operator finds there what can be asked of which device."""
    shown = _run("fault", "--help")
    for device, kinds in FAULTS_OF_DEVICE.items():
        assert f"{device}:" in shown
        assert all(kind.value in shown for kind in kinds)


def test_presses_without_noise_say_what_the_noise_is(tmp_path: Path) -> None:
    """Images are numbered from --first on; the JSON has the noise that was left out."""
    shown = _run(
        *("presses", "--out", tmp_path / "check", "--count", 5, "--first", 41, "--noise-free"),
        *("--json", tmp_path / "check.json"),
    )
    assert "5 presses of a 4.70 mm ball on an emulated GelSight Mini" in shown
    assert "--scale 15.77,15.77px/mm" in shown
    names = sorted(path.name for path in (tmp_path / "check").glob("press-*.png"))
    assert names == [f"press-{number}.png" for number in range(41, 46)]
    found = json.loads((tmp_path / "check.json").read_text())
    assert found["first"] == 41
    assert 0.0 < found["left_out"]["noise"] < found["left_out"]["recorded"]
    assert f"{found['left_out']['noise']:.2f} grey levels" in shown


def test_recorded_presses_leave_nothing_out(tmp_path: Path) -> None:
    """With noise there is nothing to say of it."""
    shown = _run("presses", "--out", tmp_path / "presses", "--count", 5)
    assert "left out" not in shown
    assert (tmp_path / "presses" / "circles.csv").read_text().count("press-") == 5
