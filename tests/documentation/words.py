"""Words of the pages that people write, as ``wc -w`` counts them: ``make words``."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGE_LIMIT = 1_500
TOTAL_LIMIT = 30_000


def hand_written() -> list[Path]:
    """Return README, CONTRIBUTING and every page outside of ``docs/results``."""
    pages = [page for page in DOCS.rglob("*.md") if DOCS / "results" not in page.parents]
    return sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *pages])


def words(page: Path) -> int:
    """Return how many words a page has, with those and the bars of tables and code."""
    return len(page.read_text("utf-8").split())


if __name__ == "__main__":
    counts = {page: words(page) for page in hand_written()}
    for page, count in sorted(counts.items(), key=lambda item: -item[1]):
        sys.stdout.write(f"{count:6}  {page.relative_to(ROOT)}\n")
    sys.stdout.write(f"{sum(counts.values()):6}  of {TOTAL_LIMIT}\n")
