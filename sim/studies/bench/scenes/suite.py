"""The scenes, pressed in every way that was asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import nan
from statistics import geometric_mean

from sim.studies.bench.scenes.catalogue import BenchScene
from sim.studies.bench.scenes.own_process import Order, SceneRow, pressed_together
from sim.studies.bench.scenes.references import Reference


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneBench:
    """What was measured.

    Attributes:
        groups: The rows of every way to press: tolerance, device, environments.
        references: By the scene's name.
        interrupted: Not all that was asked for is there.
    """

    groups: tuple[tuple[SceneRow, ...], ...] = ()
    references: dict[str, Reference] = field(default_factory=dict)
    interrupted: bool = False


def speeds(rows: Sequence[SceneRow]) -> list[float]:
    """Return the frames a second of the rows that have any."""
    return [row.frames_per_s for row in rows if row.press is not None]


def mean_speed(rows: Sequence[SceneRow]) -> float:
    """Return the geometric mean of frames a second; not a number without any."""
    found = speeds(rows)
    return geometric_mean(found) if found else nan


def press_all(
    scenes: Sequence[BenchScene],
    orders: Sequence[Order],
    *,
    on_progress: Callable[[SceneRow], None],
) -> Iterator[tuple[SceneRow, ...]]:
    """Press one scene after the other, each in every way."""
    for scene in scenes:
        # Batches share a pilot.
        together = [orders] if orders[0].environments else [[order] for order in orders]
        rows: list[SceneRow] = []
        for each in together:
            for row in pressed_together(scene, each):
                on_progress(row)
                rows.append(row)
        yield tuple(rows)


def said(row: SceneRow) -> str:
    """Return a row in a few words."""
    if row.press is None:
        return row.failure
    force, balance = row.press.force_n[2], row.press.balance
    return f"{row.frames_per_s:.1f} frames/s, F_z {force:.4f} N, balance {balance:.0e}"
