"""Fits in processes of their own."""

from __future__ import annotations

import os

from sim.optics.calibrate.side_by_side import side_by_side


def _made(item: int) -> tuple[int, int]:
    return item, os.getpid()


def test_processes_share_the_work() -> None:
    """Results come in the order of the items, from other processes."""
    found = list(side_by_side(_made, [3, 1, 2], jobs=2))
    assert [item for item, _ in found] == [3, 1, 2]
    assert os.getpid() not in {process for _, process in found}


def test_one_job_stays_here() -> None:
    """Without another process nothing has to be started."""
    assert {process for _, process in side_by_side(_made, [1, 2], jobs=1)} == {os.getpid()}
