"""What the command line asks of the operator's page."""

from __future__ import annotations

import socket

import pytest
import typer

from tacauchy_rig.app.cli.watching import (
    Watched,
    contact_outline,
    page_options,
    page_told,
    viewers_of,
    watched_by,
)
from tacauchy_rig.app.viewers import options
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import ConfigError, RigError


@pytest.mark.parametrize(
    ("said", "port"), [("off", None), ("auto", 0), ("1", 1), ("8765", 8765), ("65535", 65535)]
)
def test_a_page_is_left_out_or_has_a_port(said, port):
    """A number is a port."""
    assert watched_by(said, open_page=True, twin="off", foxglove="off") == Watched(
        port=port, open_page=True
    )


@pytest.mark.parametrize("said", ["0", "65536", "on", "-1", "80.5", ""])
def test_what_is_no_port_is_refused(said):
    """With what to give instead."""
    with pytest.raises(ConfigError, match="no port") as caught:
        watched_by(said, open_page=False, twin="off", foxglove="off")
    assert "off" in caught.value.remedy


def test_the_outline_lies_where_the_sensors_file_says():
    """In the middle of a GelSight Mini's frame, as large as the flat face of the indenter."""
    outline = contact_outline(load_config(None).config)
    assert outline.centre_px == pytest.approx((319.5, 239.5))
    assert outline.flat_radius_m == pytest.approx(2.4e-3)
    # A sixth of the frame's width is cut off in all; 0.0634 mm is a pixel of 320 across the rest.
    assert outline.scale_px_m[0] == pytest.approx(0.7 * 640 / 320 / 0.0634e-3, rel=1e-3)


def test_the_outline_grows_with_the_frame_and_moves_with_the_tool():
    """Frames of another size show the same place; a stated offset moves it."""
    small = contact_outline(load_config(None).config)
    large = contact_outline(
        load_config(None, overrides=["camera.width=3280", "camera.height=2464"]).config
    )
    assert large.scale_px_m[0] / small.scale_px_m[0] == pytest.approx(3280 / 640)
    moved = contact_outline(load_config(None, overrides=['replay.offset=["1 mm", "0 mm"]']).config)
    assert abs(moved.centre_px[0] - small.centre_px[0]) == pytest.approx(1e-3 * small.scale_px_m[0])


def test_a_ball_has_its_own_radius_and_no_flat_face():
    """Its contact's size is a matter of depth."""
    ball = contact_outline(
        load_config(None, overrides=['indenter.kind="sphere"', 'indenter.diameter="6 mm"']).config
    )
    assert (ball.flat_radius_m, ball.ball_radius_m) == (0.0, pytest.approx(3e-3))


def test_no_page_has_no_options():
    """``--page off``."""
    assert page_options(load_config(None).config, port=None) is None


@pytest.mark.parametrize("said", ["on", "0", "70000", "-1"])
def test_foxglove_wants_a_port(said: str) -> None:
    """A number from 1 to 65535, or `off`."""
    with pytest.raises(ConfigError, match="--foxglove"):
        watched_by("off", open_page=False, twin="off", foxglove=said)


@pytest.mark.parametrize("which", ["port", "foxglove"])
def test_a_taken_port_is_told_before_anything_starts(which: str) -> None:
    """By the option that asked for it."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        watched = Watched(**{"port": None, which: taken.getsockname()[1]})
        with pytest.raises(ConfigError, match="--page" if which == "port" else "--foxglove"):
            viewers_of(watched)


def test_a_missing_package_is_told_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything starts."""
    monkeypatch.setattr(options, "find_spec", lambda _name: None)
    with pytest.raises(ConfigError, match="foxglove-sdk") as caught:
        viewers_of(Watched(port=None, foxglove=8765))
    assert "tacauchy-rig[foxglove]" in caught.value.remedy


def test_the_twin_is_shown_where_both_are_wanted() -> None:
    """Each is a viewer of its own; the live one names the twin as its source."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    viewers = viewers_of(Watched(port=None, twin="force", foxglove=port))
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
    with page_told(page):  # type: ignore[arg-type]
        raise RigError("F_z cannot be reached", remedy="press less")


def test_a_page_is_told_that_a_run_could_not_be_analysed_and_is_let_go() -> None:
    """With the error that the terminal shows; an exit code is no error."""
    page = ToldPage()
    with pytest.raises(RigError):
        fail(page)
    assert [state for state, _ in page.told] == ["analysing", "failed"]
    assert "cannot be reached" in page.told[-1][1]
    with pytest.raises(typer.Exit), page_told(page):  # type: ignore[arg-type]
        raise typer.Exit(1)
    assert page.told[-1][0] == "analysing"
    assert page.released == 2
