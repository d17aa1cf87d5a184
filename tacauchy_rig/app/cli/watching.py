"""How an operator watches a run: the page, a twin, and the viewers that labs have."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Protocol

import typer

from tacauchy_rig.app.cli.output import say
from tacauchy_rig.core.config.model import IndenterKind, RigConfig
from tacauchy_rig.core.errors import ConfigError, RigError

if TYPE_CHECKING:
    from protocols.processes.messages import ContactOutline, PageOptions, ViewerOptions
    from protocols.processes.viewing import Viewing

Page = Annotated[
    str,
    typer.Option(
        "--page",
        metavar="PORT|off",
        help="Port of the operator's page; `off` serves none, `auto` takes a free one.",
    ),
]
Twin = Annotated[
    str,
    typer.Option(
        "--twin",
        metavar="on|depth|off",
        help="A simulation that follows the measured force (on) or the arm's depth (depth).",
    ),
]
Live = Annotated[
    str,
    typer.Option(
        "--foxglove",
        metavar="PORT|off",
        help="Show the run to Foxglove, Lichtblick or PlotJuggler on this machine; 8765 is usual.",
    ),
]
OpenPage = Annotated[bool, typer.Option("--open", help="Open the page in a browser.")]

PAGE_WORDS = {"off": None, "auto": 0}
TWIN_WORDS = {"off": "", "on": "force", "force": "force", "depth": "depth"}
_PORT_LAST = 65535


@dataclass(frozen=True, slots=True, kw_only=True)
class Watched:
    """How the operator watches a run.

    Attributes:
        port: Of the page; 0 is a free one, None no page.
        open_page: Whether a browser is opened on it.
        twin: What a twin follows, ``force`` or ``depth``; empty for no twin.
        foxglove: Port that Foxglove's protocol is spoken at; None for none.
    """

    port: int | None = 0
    open_page: bool = False
    twin: str = ""
    foxglove: int | None = None


def watched_by(page: str, open_page: bool, twin: str, foxglove: str) -> Watched:
    """Return what the options ask for.

    Raises:
        ConfigError: ``--page`` or ``--foxglove`` is no port, or ``--twin`` no word for one.
    """
    if twin not in TWIN_WORDS:
        raise ConfigError(f"--twin {twin}: no such twin", remedy="give `on`, `depth` or `off`")
    port = PAGE_WORDS[page] if page in PAGE_WORDS else _port("--page", page)
    live = None if foxglove == "off" else _port("--foxglove", foxglove)
    return Watched(port=port, open_page=open_page, twin=TWIN_WORDS[twin], foxglove=live)


def viewers_of(watched: Watched) -> list[ViewerOptions]:
    """Return the viewers besides the page; a port that is taken is refused here.

    Raises:
        ConfigError: A port cannot be had, or a package is missing.
    """
    from protocols.processes.viewing import listen
    from tacauchy_rig.app.twin.twin import Follows, twin_options
    from tacauchy_rig.app.viewers.options import address, viewer_options

    if watched.port:
        listen(watched.port).close()
    viewers = [twin_options(Follows(watched.twin))] if watched.twin else []
    if watched.foxglove is not None:
        viewers.append(viewer_options(watched.foxglove))
        say(f"live {address(watched.foxglove)}")
    return viewers


def _port(option: str, text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= _PORT_LAST:
        raise ConfigError(
            f"{option} {text}: no port, which is a number from 1 to {_PORT_LAST}",
            remedy="leave it out, or give `off`",
        )
    return int(text)


def page_options(config: RigConfig, *, port: int | None) -> PageOptions | None:
    """Return what page a run is to have; None for none.

    Args:
        config: Of the run.
        port: Of the page; 0 for a free one, None for no page.
    """
    from protocols.processes.messages import PageOptions

    return None if port is None else PageOptions(port=port, outline=contact_outline(config))


def contact_outline(config: RigConfig) -> ContactOutline | None:
    """Return where the contact should be seen in the camera's frames; None of a tool of triangles.

    The sensor's file states which part of a frame is scored, and the size of its pixels.
    """
    import numpy as np

    from protocols.processes.messages import ContactOutline
    from sim.sensor.sensor import load_sensor

    if config.replay.indenter is not None:
        return None
    camera = load_sensor(config.sensor.name).camera
    frame = config.camera.width, config.camera.height
    kept = 1.0 - 2.0 * camera.crop_fraction
    # Frame pixels to one pixel of the scored image, along and across.
    larger = kept * frame[0] / camera.width, kept * frame[1] / camera.height
    offset = config.replay.offset or (0.0, 0.0)
    column, row = camera.to_pixels(np.array(offset)).tolist()
    begin = camera.crop_fraction * frame[0], camera.crop_fraction * frame[1]
    is_ball = config.indenter.kind is IndenterKind.SPHERE
    radius_m = 0.5 * config.indenter.diameter
    return ContactOutline(
        image_size_px=frame,
        centre_px=(
            begin[0] + (column + 0.5) * larger[0] - 0.5,
            begin[1] + (row + 0.5) * larger[1] - 0.5,
        ),
        scale_px_m=(larger[0] / camera.scale_x_m, larger[1] / camera.scale_y_m),
        flat_radius_m=0.0 if is_ball else radius_m - config.indenter.fillet,
        ball_radius_m=radius_m if is_ball else 0.0,
    )


class PageTeller(Protocol):
    """Tells the operator's page what is done with a recorded run."""

    def __call__(self, state: str, text: str, /, *, passed: bool | None = None) -> None:
        """Tell it: ``analysing``, ``reported`` or ``failed``."""


def tell_nobody(_state: str, _text: str, /, *, passed: bool | None = None) -> None:
    """Tell nobody: there is no page."""


@contextmanager
def page_told(page: Viewing | None) -> Iterator[PageTeller]:
    """Give what tells a page that was kept, of an error too; then leave it to who watches it."""
    if page is None:
        yield tell_nobody
        return
    try:
        page.tell_page("analysing", "simulating the presses")
        yield page.tell_page
    except (RigError, KeyboardInterrupt) as error:
        page.tell_page("failed", str(error) or "aborted by Ctrl-C")
        raise
    finally:
        page.release()


def open_in_browser(address: str) -> None:
    """Open the page in a browser; the run does not wait for one."""
    threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
