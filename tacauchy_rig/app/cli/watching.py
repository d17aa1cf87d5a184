"""How an operator watches a run: page, twin, and the viewers that labs have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig.app.cli.output import say
from tacauchy_rig.core.errors import ConfigError

if TYPE_CHECKING:
    from protocols.processes.messages import ViewerOptions

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


def wishes_of(watched: Watched) -> list[ViewerOptions]:
    """Return the viewers besides the page; a port that is taken is told here.

    Raises:
        ConfigError: A port cannot be had, or a package is missing.
    """
    from protocols.processes.viewing import listen
    from tacauchy_rig.app.twin.wish import Follows, twin_wish
    from tacauchy_rig.app.viewers.wish import address, live_wish

    if watched.port:
        listen(watched.port).close()
    viewers = [twin_wish(Follows(watched.twin))] if watched.twin else []
    if watched.foxglove is not None:
        viewers.append(live_wish(watched.foxglove))
        say(f"live {address(watched.foxglove)}")
    return viewers


def _port(option: str, text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= _PORT_LAST:
        raise ConfigError(
            f"{option} {text}: no port, which is a number from 1 to {_PORT_LAST}",
            remedy="leave it out, or give `off`",
        )
    return int(text)
