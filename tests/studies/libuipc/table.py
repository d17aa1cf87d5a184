"""libuipc's rows as tables, each beside ours of as many environments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from sim.studies.bench.scenes import FRAME_COUNT, Reference, ScenePress, SceneRow
from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.tables import Cell, Table, table_of
from tests.studies.libuipc.rows import PeerRow


def peer_tables(
    groups: Sequence[Sequence[SceneRow]],
    references: Mapping[str, Reference],
    peers: Sequence[Sequence[PeerRow]],
) -> Iterator[Table]:
    """Return a table for every way in which libuipc pressed.

    Args:
        groups: Our rows, by manner.
        references: What forces are compared with, by scene.
        peers: Its rows, by manner.
    """
    ours = {(row.scene, _count(row)): row.press for rows in groups for row in rows}
    for rows in peers:
        yield _beside(rows, ours, references)


def _count(row: SceneRow) -> int:
    return row.manner.environments or 1


def _beside(
    rows: Sequence[PeerRow],
    ours: Mapping[tuple[str, int], ScenePress | None],
    references: Mapping[str, Reference],
) -> Table:
    def our(row: SceneRow) -> ScenePress | None:
        return ours.get((row.scene, _count(row)))

    def error(row: SceneRow, press: ScenePress | None) -> Cell:
        known = references.get(row.scene)
        if known is None or press is None:
            return None
        return f"{1e2 * known.error(press):+.1f}"

    def speed(row: SceneRow, press: ScenePress | None) -> float | None:
        return None if press is None else FRAME_COUNT * (_count(row)) / press.wall_s

    def ratio(row: SceneRow) -> Cell:
        own, theirs = speed(row, our(row)), speed(row, row.press)
        return None if own is None or theirs is None else f"{own / theirs:.3g}"

    def shown(value: float | None) -> Cell:
        return None if value is None else round(value)

    def balance(press: ScenePress | None) -> Cell:
        return None if press is None else f"{press.balance:.0e}"

    return table_of(
        rows,
        {
            "scene": lambda row: row.scene,
            "ours [1/s]": lambda row: shown(speed(row, our(row))),
            "libuipc [1/s]": lambda row: row.failure or shown(speed(row, row.press)),
            "ours over it": ratio,
            "F_z off by [%]": lambda row: error(row, our(row)),
            "its [%]": lambda row: error(row, row.press),
            "balance": lambda row: balance(our(row)),
            "its balance": lambda row: balance(row.press),
        },
        **table_prose(
            "tests.studies.libuipc",
            "table.md.jinja",
            "peer",
            engine=rows[0].engine,
            environments=rows[0].manner.environments,
            remarks=[f"{row.scene}: {row.remark}" for row in rows if row.remark],
        ),
    )
