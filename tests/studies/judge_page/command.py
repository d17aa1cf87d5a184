"""``python -m tests.studies judge-page``: several judgements as one page of Markdown."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from tacauchy_rig.app.cli.output import say, write_text
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.atomic_write import write_atomically
from tacauchy_rig.core.store.run_files import read_bytes
from tacauchy_rig.core.tables import Cell, Table, table_of_rows

PICTURE_PX = 800  # wide, for a page on a screen
SHOWN = {"contact": None, "frame": ("ssim", "psnr_db")}
"""Scores of the tables of a judgement; None is all."""


def judge_page(
    folders: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="That `judge` wrote, each.")
    ],
    out: Annotated[Path, typer.Option("--out", help="The page.")] = Path("docs/results/judged.md"),
) -> None:
    """Write judgements as one page, with their pictures.

    Example: judge-page judged-mini judged-dry
    """
    from tacauchy_rig.core.markdown_page import page

    runs = []
    for folder in folders:
        judged = _json(folder / "judged.json")
        name = str(judged["provenance"]["name"])
        picture = out.parent / "images" / f"judged_{name.replace('-', '_')}.png"
        _write_picture(folder / "judged.png", picture)
        runs.append(
            {
                "name": name,
                "judged": judged,
                "picture": f"images/{picture.name}",
                "table": _table(judged),
                "times": _times(judged),
                "lost": [c for c in judged["contests"] if c["is_lost"]],
                "count": len(judged["contests"]),
            }
        )
        say(f"{name}: {len(judged['simulators'])} simulators, {len(runs[-1]['lost'])} scores lost")
    write_text(out, page("tests.studies.judge_page", "judge_page.md.jinja", {"runs": runs}))
    say(f"page {out}")


def _json(path: Path) -> Any:
    data = read_bytes(path, what="a judgement")
    try:
        return json.loads(data)
    except ValueError as error:
        raise RecordError(f"{path}: no JSON: {error}", remedy="write it again") from error


def _write_picture(source: Path, path: Path) -> None:
    import cv2

    from tacauchy_rig.core.image_codec import decode_rgb, encode_png

    image = decode_rgb(read_bytes(source, what="the picture of a judgement"))
    if image is None:
        raise RecordError(f"{source}: no readable picture", remedy="`judge` writes it again")
    height = round(image.shape[0] * PICTURE_PX / image.shape[1])
    small = cv2.resize(image, (PICTURE_PX, height), interpolation=cv2.INTER_AREA)
    write_atomically(path, encode_png(small.astype("uint8")))


def _table(judged: Mapping[str, Any]) -> Table:
    """Return floors, simulators and the ceiling, a row each."""
    scores = [
        score
        for table, keys in SHOWN.items()
        for score in judged["tables"][table]
        if keys is None or score["key"] in keys
    ]
    scores += [s for s in judged["tables"]["mechanics"] if _is_known(s["key"], judged)]
    rows = [_row(f"floor: {each['name']}", each["means"], scores) for each in judged["floors"]]
    for each in judged["simulators"]:
        name = f"**{each['title']}**" if each["is_ours"] else each["title"]
        won = f"{each['own_press_wins']} of {each['own_press_wins_of']}"
        time_ms = each["milliseconds_an_image"]
        rows.append(_row(name, each["means"], scores, won=won, time_ms=time_ms))
    if judged["ceiling"] is not None:
        rows.append(
            _row(f"ceiling: {judged['ceiling']['name']}", judged["ceiling"]["means"], scores)
        )
    return table_of_rows(rows)


def _is_known(key: str, judged: Mapping[str, Any]) -> bool:
    return any(each["means"][key]["mean"] is not None for each in judged["simulators"])


def _row(
    name: str,
    means: Mapping[str, Any],
    scores: Sequence[Mapping[str, Any]],
    *,
    won: str = "",
    time_ms: float | None = None,
) -> dict[str, Cell]:
    row: dict[str, Cell] = {"": name}
    for score in scores:
        mean = means.get(score["key"], {}).get("mean")
        shown = None if mean is None else f"{score['factor'] * mean:.{score['digits']}f}"
        row[score["heading"]] = shown
    row["correct press wins"] = won
    row["ms an image"] = None if time_ms is None else f"{time_ms:.0f}"
    return row


def _times(judged: Mapping[str, Any]) -> list[str]:
    return [
        f"{each['title']}: {each['machine'] or 'machine not stated'}. "
        f"{'Fitted to these same presses. ' if each['fitted_to_these'] else ''}{each['note']}"
        for each in judged["simulators"]
    ]
