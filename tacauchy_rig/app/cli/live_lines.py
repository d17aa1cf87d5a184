"""The few lines of a terminal that follow a press: step, force bar, time left, how to stop."""

from __future__ import annotations

from rich.console import Group
from rich.text import Text

NARROWEST = 10
FULL, EMPTY, MARK = "━", "─", "┃"
HOW_TO_STOP = "any key stops and takes the arm slowly off the gel; once more holds it where it is"


def live_lines(
    *,
    step: str,
    trial: str,
    force_n: float | None,
    target_n: float | None,
    tolerance_n: float,
    limit_n: float,
    height_m: float | None,
    left_s: float | None,
    width: int,
) -> Group:
    """Return the lines; a narrow terminal cuts ends off, and what matters most stands first.

    Args:
        step: What the arm does.
        trial: Which trial it is.
        force_n: Pressing force [N]; None before the first.
        target_n: What is pressed to [N]; None before the first trial.
        tolerance_n: How far off it may be [N].
        limit_n: Soft limit, where the bar ends [N].
        height_m: Of the tip [m].
        left_s: How long the run still takes [s]; None before it begins.
        width: Of the terminal.
    """
    target = "" if target_n is None else f" of {target_n:.3f} ± {tolerance_n:g} N,"
    force = f"  {0.0 if force_n is None else force_n:6.3f} N "
    after = f"{target} limit {limit_n:g} N"
    bar = force_bar(force_n, target_n, limit_n=limit_n, width=width - len(force) - len(after) - 1)
    place = "" if height_m is None else f"   z {height_m * 1e3:.3f} mm"
    left = "" if left_s is None else f"   about {clock(left_s)} left"
    when_and_where = f"{left}{place}".lstrip()
    lines = (f"  {step}   {trial}", f"{force}{bar}{after}", f"  {when_and_where}")
    texts = [Text(line, no_wrap=True, overflow="crop") for line in (*lines, f"  {HOW_TO_STOP}")]
    texts[-1].stylize("bold")
    return Group(*texts)


def force_bar(force_n: float | None, target_n: float | None, *, limit_n: float, width: int) -> str:
    """Return a bar from nothing to the limit, the target marked; empty where there is no room."""
    if width < NARROWEST:
        return ""
    full = round(width * min(max(force_n or 0.0, 0.0) / limit_n, 1.0))
    cells = [FULL] * full + [EMPTY] * (width - full)
    if target_n is not None and target_n <= limit_n:
        cells[min(round(width * target_n / limit_n), width - 1)] = MARK
    return "".join(cells)


def clock(seconds: float) -> str:
    """Return a time as one says it."""
    whole = round(seconds)
    return f"{whole} s" if whole < 60 else f"{whole // 60} min {whole % 60:02d} s"
