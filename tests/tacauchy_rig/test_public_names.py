"""The names that users import from ``tacauchy_rig``."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import tacauchy_rig


@pytest.mark.parametrize("name", tacauchy_rig.__all__)
def test_each_public_name_exists(name: str) -> None:
    """A renamed module or function must be renamed in the table too."""
    assert getattr(tacauchy_rig, name) is not None


def test_type_checkers_see_the_same_names() -> None:
    """The imports for type checkers and the table of lazy imports agree."""
    tree = ast.parse(Path(tacauchy_rig.__file__).read_text("utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    imported = {
        alias.asname: f"{node.module}:{alias.name}"
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert imported == tacauchy_rig._PUBLIC


def test_importing_the_package_loads_no_simulator() -> None:
    """``import tacauchy_rig`` is fast: neither Warp nor NumPy comes with it."""
    code = "import sys, tacauchy_rig; print({'warp', 'numpy', 'sim'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_an_unknown_name_is_refused() -> None:
    """A wrong name is an ``AttributeError`` as of any module."""
    with pytest.raises(AttributeError, match="no attribute 'squeeze'"):
        _ = tacauchy_rig.squeeze
