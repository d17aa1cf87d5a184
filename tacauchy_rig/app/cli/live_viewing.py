"""How an operator watches a run: the page, a twin, and the viewers that labs have."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from tacauchy_rig.app.cli.output import say
from tacauchy_rig.core.config.settings import IndenterKind, RigConfig
from tacauchy_rig.core.errors import ConfigError, RigError

if TYPE_CHECKING:
    from protocols.processes.child_process import Viewing
    from protocols.processes.ipc import ViewerOptions

TWIN_WORDS = {"off": "", "on": "force", "force": "force", "depth": "depth"}
"""What a twin follows, by the words of ``--twin``."""
_PORT_LAST = 65535


def port_of(option: str, text: str) -> int | None:
    """Return a port; 0 is a free one, None is none.

    Raises:
        ConfigError: It is no number from 1 to 65535, and no word.
    """
    words = {"off": None, "auto": 0} if option == "--page" else {"off": None}
    if text in words:
        return words[text]
    if not text.isdecimal() or not 1 <= int(text) <= _PORT_LAST:
        raise ConfigError(
            f"{option} {text}: no port, which is a number from 1 to {_PORT_LAST}",
            remedy="leave it out, or give `off`",
        )
    return int(text)


def viewers_of(*, twin: str = "", foxglove: int | None = None) -> list[ViewerOptions]:
    """Return the viewers besides the page.

    Args:
        twin: What a twin follows, ``force`` or ``depth``; empty for no twin.
        foxglove: Port that Foxglove's protocol is spoken at.

    Raises:
        ConfigError: The port cannot be had, or a package is missing.
    """
    from tacauchy_rig.app.twin.run_follower import Follows, twin_options
    from tacauchy_rig.app.viewers.foxglove_options import address, viewer_options

    viewers = [twin_options(Follows(twin))] if twin else []
    if foxglove is not None:
        viewers.append(viewer_options(foxglove))
        say(f"live {address(foxglove)}")
    return viewers


def contact_outline(config: RigConfig) -> dict[str, Any] | None:
    """Return where the contact should be seen in the camera's frames; None of a tool of triangles.

    The sensor's file states which part of a frame is scored, and the size of its pixels.

    Returns:
        Size of a frame [px]; centre from its left and top [px]; pixels to a metre along and across;
        radius of a flat face, or of a ball [m], the other one is 0.
    """
    import numpy as np

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
    return {
        "image_size_px": frame,
        "centre_px": (
            begin[0] + (column + 0.5) * larger[0] - 0.5,
            begin[1] + (row + 0.5) * larger[1] - 0.5,
        ),
        "scale_px_m": (larger[0] / camera.scale_x_m, larger[1] / camera.scale_y_m),
        "flat_radius_m": 0.0 if is_ball else radius_m - config.indenter.fillet,
        "ball_radius_m": radius_m if is_ball else 0.0,
    }


def tell(page: Viewing | None, state: str, text: str, *, passed: bool | None = None) -> None:
    """Tell a page, if there is one, that a run is ``analysing``, ``reported`` or ``failed``."""
    if page is not None:
        page.tell_page(state, text, passed=passed)


@contextmanager
def told_of_errors(page: Viewing | None) -> Iterator[None]:
    """Tell a page that was kept of an error; then leave it to who watches it."""
    tell(page, "analysing", "simulating the presses")
    try:
        yield
    except (RigError, KeyboardInterrupt) as error:
        tell(page, "failed", str(error) or "aborted by Ctrl-C")
        raise
    finally:
        if page is not None:
            page.release()


def open_in_browser(address: str) -> None:
    """Open the page in a browser; the run does not wait for one."""
    threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
