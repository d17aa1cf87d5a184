"""The messages on the page of troubleshooting are those of the program."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text("utf-8")
OTHERS = ("No module named 'sim.press'",)  # python says these


def _texts() -> str:
    """Return the sources, with strings joined that stand on several lines."""
    folders = ("tacauchy_rig", "drivers", "protocols", "sim", "reports")
    files = (path for folder in folders for path in sorted((ROOT / folder).rglob("*.py")))
    return re.sub(r'"\s+f?"', "", "".join(path.read_text("utf-8") for path in files))


@pytest.fixture(scope="module")
def texts() -> str:
    """Everything that the program may say."""
    return _texts()


@pytest.mark.parametrize(
    "message",
    [
        message
        for heading in re.findall(r"^### (.*)$", PAGE, re.M)
        for message in re.findall(r"`([^`]*)`", heading)
        if message not in OTHERS
    ],
)
def test_the_program_says_what_the_page_explains(message: str, texts: str) -> None:
    """A heading is a part of a message, as it is printed."""
    assert message in texts
