"""The page's examples of batches run as they stand there."""

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
def test_the_examples_press_anywhere_and_draw() -> None:
    """A ball and a punch feel a force upwards, each its own, and each is seen."""
    names = _run(_EXAMPLES[0] + _EXAMPLES[1])
    found = names["found"]
    assert found.valid.all()
    assert (found.wrench[:, 2] > 0.0).all()
    images = names["images"].numpy()
    assert images.shape[0] == 2
    assert np.abs(images[0].astype(float) - images[1]).max() > 5.0
