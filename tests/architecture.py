"""The rooms of the program and what imports what, drawn from the imports: ``make architecture``."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "architecture.md"
FOLDERS = ("tacauchy_rig", "protocols", "drivers", "sim", "reports")
BEGIN, END = "<!-- drawn from the imports: begin -->", "<!-- drawn from the imports: end -->"

# Plain types, units and writers that every room may use; arrows to them would hide all others.
_SPINE = "errors|quantities|run|registry|versions|tables|page|figure_style"
EVERYWHERE = re.compile(
    rf"({'|'.join(FOLDERS)}|tacauchy_rig\.({_SPINE})|sim\.(arrays|device)|reports\.arrays)$"
)

Arrows = dict[str, set[str]]


def room_of(module: str) -> str:
    """Return the room that a module belongs to: its folder below the top, or itself in the top."""
    parts = module.split(".")
    return ".".join(parts[:2]) if len(parts) > 1 else module


def arrows() -> Arrows:
    """Return which rooms each room imports."""
    graph = grimp.build_graph(*FOLDERS, cache_dir=None)
    found: Arrows = defaultdict(set)
    for module in graph.modules:
        here = room_of(module)
        found[here] |= {
            room_of(imported) for imported in graph.find_modules_directly_imported_by(module)
        } - {here}
    return {
        room: {target for target in targets if not EVERYWHERE.match(target)}
        for room, targets in found.items()
        if not EVERYWHERE.match(room)
    }


def reachable(start: str, found: Arrows) -> set[str]:
    """Return every room that a room imports, directly or through others."""
    seen: set[str] = set()
    todo = [start]
    while todo:
        for target in found.get(todo.pop(), ()):
            if target not in seen:
                seen.add(target)
                todo.append(target)
    return seen


def reduced(found: Arrows) -> Arrows:
    """Leave out each arrow that a longer way through other rooms says already."""
    return {
        room: {
            target
            for target in targets
            if not any(target in reachable(other, found) for other in targets - {target})
        }
        for room, targets in found.items()
    }


def circles(found: Arrows) -> list[str]:
    """Return the rooms that import themselves through others."""
    return sorted(room for room in found if room in reachable(room, found))


def drawing(found: Arrows) -> str:
    """Return the rooms and their arrows as a Mermaid flow chart."""
    return "\n".join(_lines(reduced(found)))


def _lines(found: Arrows) -> Iterator[str]:
    yield "flowchart TD"
    rooms = sorted({*found, *(target for targets in found.values() for target in targets)})
    for folder in FOLDERS:
        yield f"  subgraph {folder}"
        for room in rooms:
            if room.startswith(f"{folder}."):
                yield f"    {_key(room)}[{room.removeprefix(folder + '.')}]"
        yield "  end"
    for room in rooms:
        for target in sorted(found.get(room, ())):
            yield f"  {_key(room)} --> {_key(target)}"


def _key(room: str) -> str:
    return room.replace(".", "_")


def room_table(found: Arrows) -> str:
    """Return what each room says of itself, as a table."""
    rows = [f"| `{room.replace('.', '/')}` | {first_line(room)} |" for room in sorted(found)]
    return "\n".join(["| room | what it holds |", "|---|---|", *rows])


def first_line(module: str) -> str:
    """Return the first line of a module's docstring."""
    path = ROOT.joinpath(*module.split("."))
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return (ast.get_docstring(ast.parse(path.read_text("utf-8"))) or "").splitlines()[0]


def drawn() -> str:
    """Return the part of the page that is made from the imports."""
    found = arrows()
    return "\n\n".join([BEGIN, f"```mermaid\n{drawing(found)}\n```", room_table(found), END])


def with_drawing(page: str) -> str:
    """Return the page with that part made anew."""
    before, rest = page.split(BEGIN)
    return before + drawn() + rest.split(END)[1]


if __name__ == "__main__":
    PAGE.write_text(with_drawing(PAGE.read_text("utf-8")), encoding="utf-8")
