"""Each kind of recording ends with the right forces, or is refused in the table's own terms."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.tacauchy_rig.app.importing.kinds import KINDS, failure

SEED = 20261127


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_ends_as_it_has_to(kind: str, tmp_path: Path) -> None:
    """One draw; ``python -m tests.tacauchy_rig.app.importing.kinds`` makes many."""
    root = tmp_path / "source"
    root.mkdir()
    assert not failure(kind, root, seed=SEED)
