"""Mocks as the drivers of another package, so that the processes of a run find them."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tacauchy_rig.core.config import load
from tacauchy_rig.core.config.load import LoadedConfig

_METADATA = Path(__file__).parent / "metadata"
_ROOT = Path(__file__).parents[2]
_MOCKS = [f'{device}.driver="mock"' for device in ("robot", "force_sensor", "camera")]


@contextmanager
def mocks_installed() -> Iterator[None]:
    """Let this process and its children find ``driver = "mock"``."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(_METADATA)
        known = os.environ.get("PYTHONPATH", "")
        patch.setenv("PYTHONPATH", os.pathsep.join([str(_METADATA), str(_ROOT), known]))
        yield


def load_mocks(*overrides: str) -> LoadedConfig:
    """Return the dry run with mocks; its values are given, as those of a real arm have to be."""
    file = Path(load.__file__).parent / "default.toml"
    return load.load_config(file, overrides=[*_MOCKS, *overrides])
