"""No import cycles, and names in texts that exist."""

import importlib
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

from tacauchy_rig.core.registry import Kind
from tests.architecture import FOLDERS, ROOT, arrows, cycles, file_arrows, reduced


def test_no_package_and_no_file_imports_itself_through_others() -> None:
    """Every package imports only rows below it, and so do files."""
    files = file_arrows()
    assert cycles(arrows(files)) == []
    assert cycles(files) == []


def test_reduction_keeps_what_can_be_reached() -> None:
    """An arrow is left out only where a longer path says it."""
    found = {"a": {"b", "c"}, "b": {"c"}, "c": set[str]()}
    assert reduced(found) == {"a": {"b"}, "b": {"c"}, "c": set()}
    assert cycles({"a": {"b"}, "b": {"a"}, "c": {"a"}}) == ["a", "b"]


def _texts() -> list[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "*.py", "*.md", "*.toml", "*.jinja", ":!CHANGELOG.md"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return [ROOT / name for name in listed.stdout.split()]


_MODULE = re.compile(rf"``?((?:{'|'.join(FOLDERS)})(?:\.(?!py\b)[a-z_0-9]+)+)``?")
_FILE = re.compile(rf"[`( ]((?:{'|'.join(FOLDERS)}|tests)(?:/[\w.]+)+\.(?:py|toml|json))[`) ,.;]")


def test_names_in_texts_exist() -> None:
    """Each module and file that a page or docstring names is there; the changelog has old ones."""
    missing = {path: [*_missing_names(path.read_text("utf-8"))] for path in _texts()}
    assert {str(path): names for path, names in missing.items() if names} == {}


def _missing_names(text: str) -> Iterator[str]:
    yield from (name for name in _MODULE.findall(text) if not _exists(name))
    yield from (name for name in _FILE.findall(text) if not (ROOT / name).exists())


def _exists(name: str) -> bool:
    """Return whether a dotted name is a module, something in one, or a group of entry points."""
    if name in {kind.group for kind in Kind}:
        return True
    parent, _, last = name.rpartition(".")
    if importlib.util.find_spec(parent) is None:
        return False
    try:
        if importlib.util.find_spec(name) is not None:
            return True
    except ModuleNotFoundError:
        pass
    return hasattr(importlib.import_module(parent), last)
