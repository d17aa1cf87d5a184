"""The import packages are this project's own."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("name", ["tacauchy_rig", "drivers", "protocols", "sim", "reports"])
def test_package_is_ours(name: str) -> None:
    """A package of the same name elsewhere on the path would be a silent disaster."""
    module = importlib.import_module(name)
    assert module.__file__ is not None
    assert Path(module.__file__).resolve().parent == ROOT / name
