"""The page's example of a batch runs as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

_PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "press-in-batches.md"


@pytest.mark.slow
def test_the_example_presses_eight_gels() -> None:
    """Stiffer gels push back harder, in proportion, and are in balance."""
    first, second, _ = re.findall(r"```python\n(.*?)```", _PAGE.read_text("utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(first + second, str(_PAGE), "exec"), names)  # noqa: S102 - our own page
    found = names["found"]
    forces = found.force_n[-1, :, 2]  # type: ignore[attr-defined]
    assert np.allclose(forces / forces[0], np.linspace(0.4, 0.5, 8) / 0.4, rtol=1e-4)
    assert np.abs(found.imbalance).max() <= 1e-6  # type: ignore[attr-defined]
