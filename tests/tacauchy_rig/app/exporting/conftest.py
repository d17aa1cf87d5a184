"""A run of the mock rig that is exported."""

from typing import Any

import pytest

from tacauchy_rig.core.store.run_store import RunStore
from tests.recorded_run import pressed_run
from tests.tacauchy_rig.core.store.conftest import Samples


@pytest.fixture(scope="session")
def ours(tmp_path_factory: pytest.TempPathFactory) -> RunStore:
    """Two presses of the mock rig."""
    return pressed_run(tmp_path_factory.mktemp("ours"))


@pytest.fixture
def samples() -> Any:
    """Samples whose content follows from their counter."""
    return Samples()
