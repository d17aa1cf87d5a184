"""The operator's page as the command line asks for it: what it draws, and who opens it."""

from __future__ import annotations

import threading
import webbrowser
from typing import TYPE_CHECKING

from tacauchy_rig.core.config.model import IndenterKind, RigConfig

if TYPE_CHECKING:
    from protocols.processes.messages import ContactOutline, PageOptions


def page_wish(config: RigConfig, *, port: int | None) -> PageOptions | None:
    """Return what page a run is to have; None for none.

    Args:
        config: Of the run.
        port: Of the page; 0 for a free one, None for no page.
    """
    from protocols.processes.messages import PageOptions

    return None if port is None else PageOptions(port=port, outline=contact_outline(config))


def contact_outline(config: RigConfig) -> ContactOutline | None:
    """Return where the contact should be seen in the camera's frames; None of a tool of triangles.

    The sensor's file says which part of a frame is scored, and how large its pixels are.
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


def open_in_browser(address: str) -> None:
    """Open the page in a browser; the run does not wait for one."""
    threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
