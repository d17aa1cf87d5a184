"""New run folders."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.store.run_store import RunStore
from tests.recorded_run import empty_run


@pytest.fixture
def new_store(tmp_path: Path) -> Callable[..., RunStore]:
    """Return a maker of run folders of the default rig, with overrides."""

    def make(*overrides: str) -> RunStore:
        loaded = load_config(overrides=list(overrides))
        return empty_run(tmp_path, loaded)

    return make
