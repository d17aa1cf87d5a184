"""JSON that every command writes."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path

import numpy as np
import pytest

from tacauchy_rig.app.cli.output import write_json
from tacauchy_rig.core.errors import RecordError


class _Colour(StrEnum):
    RED = "red"


def test_not_a_number_becomes_null(tmp_path: Path) -> None:
    """JSON knows no NaN, and a reader must not meet one."""
    path = tmp_path / "deep" / "out.json"
    write_json(path, {"a": float("nan"), "b": np.array([1.0, np.inf]), "c": _Colour.RED})
    assert json.loads(path.read_text()) == {"a": None, "b": [1.0, None], "c": "red"}


def test_unwritable_file_is_explained(tmp_path: Path) -> None:
    """The message names the file."""
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="cannot be written"):
        write_json(tmp_path / "file" / "out.json", {})
