"""Pages are short, say no commit and no day, and their links lead somewhere."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.documentation.words import DOCS, PAGE_LIMIT, ROOT, TOTAL_LIMIT, hand_written, words

SUMMARIES = [DOCS / "results" / "index.md", DOCS / "results" / "benchmarks" / "index.md"]
PAGES = [*hand_written(), *SUMMARIES]
ALL = sorted({*PAGES, *DOCS.rglob("*.md")})
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_COMMIT = re.compile(r"\b(?=[0-9a-f]*[0-9])(?=[0-9a-f]*[a-f])[0-9a-f]{7,40}\b")
_DAY = re.compile(r"\b20\d\d-\d\d-\d\d\b")
_NAMED = re.compile(r"docs/[\w/.-]*\.md")


def name(page: Path) -> str:
    """Return the path of a page from the repository's root."""
    return str(page.relative_to(ROOT))


def test_pages_are_short_and_few() -> None:
    """A page can be read at once, and all of them in an afternoon."""
    counts = {name(page): words(page) for page in hand_written()}
    assert {page: count for page, count in counts.items() if count > PAGE_LIMIT} == {}
    assert sum(counts.values()) <= TOTAL_LIMIT


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_no_commit_and_no_day(page: Path) -> None:
    """Neither says anything to who reads the page later."""
    text = page.read_text("utf-8")
    assert [*_COMMIT.findall(text), *_DAY.findall(text)] == []


@pytest.mark.parametrize("page", ALL, ids=name)
def test_links_lead_to_files(page: Path) -> None:
    """``make docs`` tests anchors too, but only within the site."""
    assert [*_broken(page)] == []


def _broken(page: Path) -> Iterator[str]:
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    for link in _LINK.findall(text):
        target = link.partition("#")[0]
        if target and "://" not in link and not (page.parent / target).exists():
            yield link


def test_pages_that_the_program_names_are_there() -> None:
    """Messages, docstrings and templates name pages by their path."""
    folders = ("tacauchy_rig", "drivers", "protocols", "sim", "reports")
    kinds = ("*.py", "*.jinja", "*.toml")
    files = (path for each in folders for kind in kinds for path in (ROOT / each).rglob(kind))
    named = {found for path in files for found in _NAMED.findall(path.read_text("utf-8"))}
    assert named
    assert sorted(page for page in named if not (ROOT / page).exists()) == []
