"""From a recorded run to its replay and from there to the report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tacauchy_rig.store.run_store import RunStore


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """What a report found."""

    content: dict[str, Any]
    passed: bool


def replay_run(store: RunStore) -> None:
    """Replay."""


def report_run(store: RunStore) -> Summary:
    """Report."""
    return Summary(content={}, passed=True)
