"""Which slopes and places of the gel a set of presses has shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.optics.calibrate.presses.ball_press import Circle
from sim.optics.calibrate.presses.samples import PressScene

BINS = 24


@dataclass(frozen=True, slots=True, kw_only=True)
class SlopeCoverage:
    """How often each slope was seen.

    Attributes:
        edges: Borders of the bins of tilt (sine of the surface's angle), shape [BINS + 1].
        presses_seen: Presses that show a tilt, by tilt along rows and columns, [BINS, BINS].
        tilt_limit: Largest tilt seen.
        share: Part of the disc of tilts up to the limit that at least one press shows.
        image_share: Part of the image that lies in at least one contact.
    """

    edges: FloatArray
    presses_seen: NDArray[np.int64]
    tilt_limit: float
    share: float
    image_share: float


def slope_coverage(circles: Sequence[Circle], scene: PressScene) -> SlopeCoverage:
    """Count slopes and places inside the contacts; at least one circle."""
    height, width = scene.background.shape[:2]
    rows, columns = (grid.ravel().astype(np.float64) for grid in np.mgrid[:height, :width])
    inside = []
    touched = np.zeros(len(rows), dtype=np.bool_)
    for circle in circles:
        near = np.hypot(columns - circle.x_px, rows - circle.y_px) <= circle.radius_px
        inside.append(scene.surface(circle, columns[near], rows[near])[0])
        touched |= near
    limit = max(float(np.hypot(*tilt).max(initial=0.0)) for tilt in inside)
    edges = np.linspace(-limit, limit, BINS + 1)
    seen = sum(
        (np.histogram2d(tilt[1], tilt[0], bins=(edges, edges))[0] > 0).astype(np.int64)
        for tilt in inside
    )
    middle = 0.5 * (edges[1:] + edges[:-1])
    disc = np.hypot(*np.meshgrid(middle, middle)) <= limit
    counted = np.asarray(seen, dtype=np.int64)
    return SlopeCoverage(
        edges=edges,
        presses_seen=counted,
        tilt_limit=limit,
        share=float(np.mean(counted[disc] > 0)) if limit > 0.0 else 0.0,
        image_share=float(touched.mean()),
    )
