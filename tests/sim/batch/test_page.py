"""The page's examples of batches run as they stand there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

_PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "press-in-batches.md"


_EXAMPLES = re.findall(r"```python\n(.*?)```", _PAGE.read_text("utf-8"), re.DOTALL)


def _run(code: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(compile(code, str(_PAGE), "exec"), names)  # noqa: S102 - our own page
    return names


@pytest.mark.slow
def test_the_example_presses_anywhere() -> None:
    """A ball and a punch feel a force upwards, each its own."""
    felt = _run(_EXAMPLES[0])["felt"]
    assert felt.valid.all()
    assert (felt.wrench[:, 2] > 0.0).all()


@pytest.mark.slow
def test_the_example_presses_eight_gels() -> None:
    """Stiffer gels push back harder, in proportion, and are in balance."""
    found = _run(_EXAMPLES[1] + _EXAMPLES[2])["found"]
    forces = found.force_n[-1, :, 2]
    assert np.allclose(forces / forces[0], np.linspace(0.4, 0.5, 8) / 0.4, rtol=1e-4)
    assert np.abs(found.imbalance).max() <= 1e-6
