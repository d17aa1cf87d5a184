"""``import FOLDER --init``: an ``import.toml`` of what a folder shows, with reasons."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from tacauchy_rig.app.importing.source_files import MIB, Source
from tacauchy_rig.app.importing.text_tables import (
    ISO,
    UNKNOWN,
    Table,
    instant,
    read_table,
    toml_value,
)
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.quantities import UNITS, Dimension
from tacauchy_rig.core.store.atomic_write import write_atomically

CHECK = "CHECK"
"""Begins a reason that a person has to look at."""
IMAGES = (".png", ".jpg", ".jpeg")
TABLES = (".csv", ".tsv", ".txt", ".dat")
VIDEOS = (".mp4", ".avi", ".mkv", ".mov")
BAGS = (".mcap", ".db3")
_REST = re.compile(r"rest|no.?contact|unload|background|^bg|^ref|idle|blank|leer|ruhe", re.I)
_HELD = re.compile(r"press|contact|held|hold|dwell|load|gedr|last|kontakt", re.I)
_ROLES: Mapping[str, tuple[Dimension | None, str]] = {
    "time": (Dimension.TIME, r"t|time|times?tamp|stamp|zeit.*|uhrzeit|datum.*|date.*"),
    "press": (None, r"press|trial|n|nr|no|number|id|versuch|press_?(id|nr|no)"),
    "state": (None, r"state|phase|label|status|contact|zustand|s"),
    "indenter": (None, r"tool|indenter|probe|tip|shape|werkzeug|stempel|geometry|object"),
    "force_x": (Dimension.FORCE, r"f_?x|force_?x"),
    "force_y": (Dimension.FORCE, r"f_?y|force_?y"),
    "force": (Dimension.FORCE, r"f|f_?z|force(_?z)?|kraft(_?z)?|load|normal.*|f_?n|weight|last"),
    "depth": (Dimension.LENGTH, r"d|dz|depth|indentation|penetration|tiefe|eindring.*|travel|weg"),
    "contact_z": (Dimension.LENGTH, r"contact_?z|z_?contact|z0"),
    "x": (Dimension.LENGTH, r"x|pos_?x|x_?pos"),
    "y": (Dimension.LENGTH, r"y|pos_?y|y_?pos"),
    "z": (Dimension.LENGTH, r"z|pos_?z|z_?pos|height"),
}
"""Of each role what its column measures, and how labs name it."""
_LOG_ROLES = {"time", "force_x", "force_y", "force", "x", "y", "z"}
_USUAL = {Dimension.FORCE: "N", Dimension.LENGTH: "mm", Dimension.TIME: "s"}
_FORMATS = (ISO, "%d.%m.%Y %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S", "%m/%d/%Y %H:%M:%S.%f")
_SHAPES = {"sphere": r"sph|ball|kugel|hemi", "cylinder": r"cyl|zyl|punch|flat|pin|stempel"}
_HEAD_UNIT = re.compile(r"^(.*?)[\s_]*[\[(/]?\s*([A-Za-z\u00b5]+)\s*[\])]?$")


@dataclass(slots=True)
class Guesses:
    """Lines of an ``import.toml``."""

    lines: list[str] = field(default_factory=list)  # keys and values, with reasons as comments
    asked: list[str] = field(default_factory=list)  # what a person has to look at

    def say(self, key: str, value: object, reason: str) -> None:
        """Write a key; a reason that begins with ``CHECK`` is also asked."""
        line = f"{key} = {toml_value(value)}"
        self.lines.append(f"{line}  # {reason}")
        if reason.startswith(CHECK):
            self.asked.append(f"{line}: {reason.removeprefix(CHECK).lstrip(': ')}")

    def head(self, table: str) -> None:
        """Begin a table."""
        self.lines.append(f"[{table}]")


def write_guess(folder: Path) -> tuple[Path, Guesses]:
    """Write the ``import.toml`` of a folder.

    Raises:
        RecordError: There is one already, or nothing in the folder is of a known kind.
    """
    target = folder / "import.toml"
    if target.exists():
        raise RecordError(
            f"{target}: is there already", remedy="edit it, or move it away and run --init again"
        )
    guesses = _guess(Source(folder))
    text = "# Guessed by `tacauchy-rig import --init`: look at every line.\n"
    write_atomically(target, (text + "\n".join([*guesses.lines, ""])).encode())
    return target, guesses


def _guess(source: Source) -> Guesses:
    """Return what a folder shows of its format and its conventions."""
    files = sorted(
        str(path.relative_to(source.root))
        for path in source.root.rglob("*")
        if path.is_file() and not any(part.startswith(".") for part in path.parts)
    )
    images, tables, videos, bags = (
        [name for name in files if Path(name).suffix.lower() in kinds]
        for kinds in (IMAGES, TABLES, VIDEOS, BAGS)
    )
    found = Guesses()
    if "meta/info.json" in files:
        _lerobot(source, found)
    elif bags:
        parent = str(Path(bags[0]).parent)
        found.say("kind", "bag", f"there is {bags[0]}")
        found.head("data")
        whole = (parent != "." and len(bags) > 1) or f"{parent}/metadata.yaml" in files
        found.say("file", parent if whole else bags[0], "topics are told by their types")
        _rig(found, files)
    elif videos and tables:
        found.say("kind", "video", f"there are {videos[0]} and {tables[0]}")
        found.head("data")
        sure = "the only one" if len(videos) == 1 else f"{CHECK}: the first"
        found.say("video", videos[0], sure)
        found.say("complete", False, f"{CHECK}: true if the recorder drops no frames")
        table = _largest(source, tables)
        found.say("log", table.name, "the longest table")
        _dialect(found, table)
        found.head("data.columns")
        roles = _roles(table).items()
        _columns(found, table, {role: column for role, column in roles if role in _LOG_ROLES})
        _rig(found, files)
    elif tables:
        _csv(source, found, tables, images)
    else:
        raise RecordError(
            f"{source.root}: holds no table, bag, video with a log, or LeRobot dataset",
            remedy="docs/reference/file-formats.md shows each format; NumPy records need an "
            "import.toml of your own",
        )
    return found


def _lerobot(source: Source, found: Guesses) -> None:
    info = json.loads(source.read("meta/info.json", field="the dataset", most_bytes=MIB))
    features: dict[str, dict[str, object]] = info.get("features", {})
    found.say("kind", "lerobot", "there is meta/info.json")
    found.head("data")
    seen = [name for name, each in features.items() if each.get("dtype") in ("image", "video")]
    touch = [name for name in seen if re.search("tact|touch|gel|digit", name)] or seen
    if touch:
        sure = len(touch) == 1
        found.say("image", touch[0], "its name" if sure else f"{CHECK}: one of {', '.join(touch)}")
    felt = [name for name in features if re.search("wrench|force|ft", name)]
    if felt:
        reason = f"{CHECK}: its name; the unit is unsaid"
        found.say("force", {"feature": felt[0], "unit": "N"}, reason)
    _rig(found, list(features))


def _csv(source: Source, found: Guesses, tables: list[str], images: list[str]) -> None:
    table = _largest(source, tables)
    found.say("kind", "csv", f"there is {table.name}, with {len(table.rows)} rows")
    found.head("data")
    found.say("table", table.name, "the longest table" if len(tables) > 1 else "the only table")
    _dialect(found, table)
    column, folder, named = _image_column(table, images)
    if column and folder:
        found.say("images", folder, f'where the names of column "{column}" are')
    others = [name for name in images if name not in named]
    rest = [name for name in others if _REST.search(Path(name).stem)]
    rest = rest or others[: int(len(others) == 1)]
    roles = _roles(table, without=column)
    states = _states(table, roles)
    if rest:
        why = "its name" if _REST.search(Path(rest[0]).stem) else f"{CHECK}: no row names it"
        found.say("no_contact", rest[0], why)
    elif column and not states:
        found.asked.append("data.no_contact: no image of the gel at rest was found; name it")
    for key, label in states.items():
        found.say(key, label, f'{CHECK}: a value of column "{roles["state"]}"')
    if not states:
        roles.pop("state", None)
        if "force" in roles:
            found.say("is_tared", True, f"{CHECK}: no row is at rest that defines a zero")
    found.head("data.columns")
    if column:
        found.say("image", column, "its cells name images of the folder")
    _columns(found, table, roles)
    if "indenter" in roles:
        _indenters(found, table, roles["indenter"])
    words = [source.root.name, *images, *table.columns]
    _rig(found, words, has_terms="indenter" in roles)


def _largest(source: Source, tables: list[str]) -> Table:
    """Return the table with most rows that can be read."""
    read = []
    for name in tables:
        with suppress(RecordError):
            read.append(read_table(source, name, field="a table"))
    if not read:
        raise RecordError(
            f"{', '.join(tables)[:200]}: no table with a head line and rows", remedy="look at them"
        )
    return max(read, key=lambda table: len(table.rows))


def _dialect(found: Guesses, table: Table) -> None:
    """Write separator and decimal sign, which columns with numbers show."""
    found.say("separator", table.separator, "parts all lines alike")
    cells = [cell.strip() for row in table.rows[:200] for cell in row]
    shown = {
        sign: [cell for cell in cells if re.fullmatch(rf"[+-]?\d*{re.escape(sign)}\d+", cell)]
        for sign in ",."
    }
    signs = [sign for sign, numbers in shown.items() if numbers]
    if len(signs) == 1:
        found.say("decimal", signs[0], f"as in {shown[signs[0]][0]}")


def _image_column(table: Table, images: Sequence[str]) -> tuple[str, str, list[str]]:
    """Return the column that names images, the folder that they are in, and those named."""
    folders = ("", *sorted({str(Path(name).parent) for name in images} - {"."}))
    for column in table.columns:
        cells = [cell.replace("\\", "/") for cell in table.cells(column) if cell]
        for folder in folders:
            whole = [f"{folder}/{cell}" if folder else cell for cell in cells]
            named = [name for name in whole if name in images]
            if named and len(named) >= len(cells) / 2:
                return column, folder, named
    return "", "", []


def _roles(table: Table, *, without: str = "") -> dict[str, str]:
    """Return roles and the columns that are named like them, each column once."""
    found: dict[str, str] = {}
    for role, (_, pattern) in _ROLES.items():
        for column in table.columns:
            is_free = column and column != without and column not in found.values()
            if is_free and re.fullmatch(pattern, _head(column)[0], re.I):
                found[role] = column
                break
    return found


def _head(column: str) -> tuple[str, str]:
    """Return name and unit of a head such as ``Fz [N]``, ``depth_mm`` or ``fz``."""
    match = _HEAD_UNIT.match(column.strip())
    units = {unit for each in UNITS.values() for unit in each}
    name, unit = column.strip(), ""
    if match and match[1] and match[2].replace("\u00b5", "u") in units:
        name, unit = match[1], match[2].replace("\u00b5", "u")
    return re.sub(r"\W+", "_", name).strip("_"), unit


def _states(table: Table, roles: Mapping[str, str]) -> dict[str, str]:
    """Return the labels of rows at rest and pressed, as far as a column has them."""
    if "state" not in roles:
        return {}
    values = list(dict.fromkeys(cell for cell in table.cells(roles["state"]) if cell))
    rest = [each for each in values if _REST.search(each) or each in ("0", "false")]
    held = [each for each in values if _HELD.search(each) and each not in rest]
    held = held or [each for each in values if each in ("1", "true")]
    return {"unloaded": rest[0], "pressed": held[0]} if rest and held else {}


def _columns(found: Guesses, table: Table, roles: Mapping[str, str]) -> None:
    """Write the columns; signs are asked when numbers are imported."""
    for role, column in roles.items():
        dimension = _ROLES[role][0]
        if dimension is None:
            found.say(role, column, "its name")
            continue
        unit, reason = _unit(table, column, dimension)
        found.say(role, {"column": column, "unit": unit}, reason)


def _unit(table: Table, column: str, dimension: Dimension) -> tuple[str, str]:
    """Return the unit of a column, and why."""
    unit, usual = _head(column)[1], _USUAL[dimension]
    if dimension is Dimension.FORCE and unit in UNITS[Dimension.MASS]:
        meant = f'is "{unit}" a force? write "{unit}f" if the balance shows grams-force'
        return unit, f"{CHECK}: {meant}"
    if unit in UNITS[dimension]:
        return unit, "its head says so"
    cells = [cell for cell in table.cells(column)[:50] if cell.lower() not in UNKNOWN]
    is_number = all(re.fullmatch(r"[+-]?[\d.,eE+-]+", cell) for cell in cells)
    if dimension is Dimension.TIME and not is_number:
        for form in _FORMATS:
            if all(math.isfinite(instant(cell, form)) for cell in cells):
                return form, f"as in {cells[0]}"
    return usual, f"{CHECK}: its head says no unit, and {usual} is usual"


def _indenters(found: Guesses, table: Table, column: str) -> None:
    """Write terms for words that name indenters."""
    words = [word for word in dict.fromkeys(table.cells(column)) if word and ":" not in word]
    if words:
        found.head("data.indenters")
    for word in words:
        size = re.search(r"\d+([.,]\d+)?", word)
        shape = next((s for s, like in _SHAPES.items() if re.search(like, word, re.I)), "")
        term, reason = "", f"{CHECK}: write its term, such as sphere:diameter=4mm"
        if size and shape:
            term = f"{shape}:diameter={size[0].replace(',', '.')}mm"
            reason = f"{CHECK}: a diameter or a radius?"
        found.say(json.dumps(word), term, reason)


def _rig(found: Guesses, words: Sequence[str], *, has_terms: bool = False) -> None:
    """Write sensor and indenter; how images are stored is asked when they are looked at."""
    told = " ".join(words).lower()
    sensor, why = "gelsight-mini", f"{CHECK}: nothing names it"
    for name in ("digit", "9dtact", "gelsight-mini"):
        if (part := name.partition("-")[0]) in told:
            sensor, why = name, f'a name has "{part}" in it'
            break
    found.head("rig.sensor")
    found.say("name", sensor, why)
    found.head("rig.replay")
    if not has_terms:
        found.say("indenter", "sphere:diameter=4mm", f"{CHECK}: nothing names it")
