"""The packages of the program and their imports: ``make architecture`` prints their table."""

import ast
import re
import sys
from collections import defaultdict
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
FOLDERS = ("tacauchy_rig", "protocols", "drivers", "sim", "reports")
LAYERS = (
    *("tacauchy_rig.app", "tacauchy_rig.envs", "reports", "protocols", "sim", "drivers"),
    "tacauchy_rig.core",
)
"""A layer imports nothing from a layer before it."""

# Types, units and writers that every package uses; arrows to them would hide all others.
_COMMON = "errors|quantities|run|registry|versions|tables|arrays|rotations"
_COMMON += "|markdown_page|plot_style|image_codec"
EVERYWHERE = re.compile(
    rf"({'|'.join(FOLDERS)}|tacauchy_rig\.(core|app|envs)|tacauchy_rig\.core\.({_COMMON})"
    r"|sim\.device)$"
)

Arrows = dict[str, set[str]]


def package_of(module: str) -> str:
    """Return the package that a module belongs to, or itself where it stands alone."""
    parts = module.split(".")
    return ".".join(parts[: 3 if parts[0] == "tacauchy_rig" else 2])


def file_arrows() -> Arrows:
    """Return which modules each module imports; imports for type checkers do not count."""
    graph = grimp.build_graph(*FOLDERS, cache_dir=None, exclude_type_checking_imports=True)
    return {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}


def arrows(files: Arrows) -> Arrows:
    """Return which packages each package imports."""
    found: Arrows = defaultdict(set)
    for module, targets in files.items():
        here = package_of(module)
        found[here] |= {package_of(target) for target in targets} - {here}
    return {
        package: {target for target in targets if not EVERYWHERE.match(target)}
        for package, targets in found.items()
        if not EVERYWHERE.match(package)
    }


def reachable(start: str, found: Arrows) -> set[str]:
    """Return everything that a package or module imports, directly or through others."""
    seen: set[str] = set()
    todo = [start]
    while todo:
        for target in found.get(todo.pop(), ()):
            if target not in seen:
                seen.add(target)
                todo.append(target)
    return seen


def reduced(found: Arrows) -> Arrows:
    """Leave out each arrow that a longer path through other packages implies."""
    return {
        package: {
            target
            for target in targets
            if not any(target in reachable(other, found) for other in targets - {target})
        }
        for package, targets in found.items()
    }


def cycles(found: Arrows) -> list[str]:
    """Return the packages or modules that import themselves through others."""
    return sorted(name for name in found if name in reachable(name, found))


def package_table(found: Arrows) -> str:
    """Return what each package holds and imports, as a table, importers before what they import."""
    arrows_left = reduced(found)
    rows = [
        f"| `{package}` | {first_line(package)} | {_listed(arrows_left[package])} |"
        for package in sorted(found, key=lambda package: _rank(package, found))
    ]
    return "\n".join(["| package | what it holds | imports |", "|---|---|---|", *rows])


def _rank(package: str, found: Arrows) -> tuple[int, int, str]:
    """Return the place of a package: its layer, then how much it imports, then its name.

    A package reaches more than each package that it imports, so these follow it.
    """
    layer = next(i for i, prefix in enumerate(LAYERS) if package.startswith(prefix))
    return layer, -len(reachable(package, found)), package


def _listed(packages: set[str]) -> str:
    return ", ".join(f"`{package}`" for package in sorted(packages))


def first_line(module: str) -> str:
    """Return the first line of a module's docstring."""
    path = ROOT.joinpath(*module.split("."))
    file = path.with_suffix(".py")
    path = file if file.exists() else path / "__init__.py"
    return (ast.get_docstring(ast.parse(path.read_text("utf-8"))) or "").splitlines()[0]


def packages() -> str:
    """Return the table of the packages as they import each other now."""
    return package_table(arrows(file_arrows()))


if __name__ == "__main__":
    sys.stdout.write(f"{packages()}\n")
