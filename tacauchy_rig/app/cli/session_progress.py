"""Progress of a session: a few live lines on a terminal, plain lines elsewhere."""

import time
from collections.abc import Sequence
from typing import Self

from rich.console import Group
from rich.live import Live
from rich.text import Text

from protocols.trials.time_left import TimeLeft
from protocols.trials.trial_sequence import PlannedTrial
from tacauchy_rig.app.cli.live_viewing import open_in_browser
from tacauchy_rig.app.cli.output import console, say
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.run import ExpectedPress, JournalEvent, Outcome

PROGRESS = "progress"
NARROWEST = 10
FULL, EMPTY, MARK = "━", "─", "┃"
HOW_TO_STOP = "any key stops and takes the arm slowly off the gel; once more holds it where it is"

PHASES = {
    "preflight": "checking all devices",
    "air-press": "test press in the air above the gel",
    "home": "moving to the home position",
    "tare": "taring the force sensor",
    "reference": "recording the no-contact image",
    "approach": "approaching the gel",
    "search": "searching for contact",
    "press": "pressing to the target",
    "dwell": "holding the force, recording images",
    "sway": "going up and down a little to measure delays",
    "retract": "retracting from the gel",
    "drift-check": "checking the force sensor's drift",
    "verdict": "judging",
    "fault": "making the arm safe",
}


_JUDGED = (Outcome.PASSED, Outcome.FAILED)
"""Outcomes of attempts that ran to their end; what cut another off is an event of its own."""


class SessionProgress:
    """Says what the arm is doing and what the gel feels; a context.

    Args:
        expected: Expected force against depth; None if unknown.
    """

    def __init__(
        self,
        config: RigConfig,
        *,
        plan: Sequence[PlannedTrial],
        expected: ExpectedPress | None = None,
        open_page: bool = False,
    ) -> None:
        self._open_page = open_page
        self._trial_count = len(config.protocol.force_targets)
        self._tolerance_n = config.protocol.force_tolerance
        self._limit_n = config.limits.soft_force
        self._target_n: float | None = None
        self._trial = 0
        self._left = TimeLeft(config, plan, expected)
        self._live = Live(console=console, refresh_per_second=8, transient=True)
        self._phase = ""
        self._force_n: float | None = None
        self._height_m: float | None = None

    def __enter__(self) -> Self:
        if console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if console.is_terminal:
            self._live.stop()

    def __call__(self, event: JournalEvent) -> None:
        """Show one event."""
        detail = event.detail
        self._left.note(event)
        self._trial = event.trial or self._trial
        match event.name:
            case "phase":
                self._enter(event)
            case "attempt-start":
                target = self._target_n = detail["force_target_n"]
                tries = f", attempt {event.attempt}" if event.attempt > 1 else ""
                say(f"trial {event.trial} of {self._trial_count}{tries}: target {target:.4f} N")
            case "attempt-end" if detail["outcome"] in _JUDGED:
                say(_ended(event))
            case "fault" | "abort":
                during = f" while {detail['during']}" if detail.get("during") else ""
                say(f"  {event.name}{during}: {detail.get('reason', '')}")
            case "attempt-repeated":
                say(f"  tried again: {detail.get('reason', '')}")
            case "page":
                say(f"page {detail['address']}")
                if self._open_page:
                    open_in_browser(detail["address"])
            case "process-died":
                say(f"  {detail.get('how', event.name)}")
            case _ if event.name == PROGRESS:
                self._update(event)

    def _enter(self, event: JournalEvent) -> None:
        name = str(event.detail.get("phase", ""))
        self._phase = PHASES.get(name, name)
        if console.is_terminal:
            self._update(event)
        elif name != "fault":  # by then the arm is safe, and the next line says what it was
            say(f"  {self._phase}")

    def _update(self, event: JournalEvent) -> None:
        # Other events carry neither force nor height; the last ones stay shown.
        self._force_n = event.detail.get("force_n", self._force_n)
        self._height_m = event.detail.get("height_m", self._height_m)
        if console.is_terminal:
            self._live.update(self.lines(console.width))

    def lines(self, width: int) -> Group:
        """Return what is shown; a narrow terminal cuts ends off, and what matters most is first.

        The bar ends at the limit.
        """
        force_n, target_n, limit_n = self._force_n, self._target_n, self._limit_n
        trial = f"trial {self._trial} of {self._trial_count}" if self._trial else ""
        target = "" if target_n is None else f" of {target_n:.3f} ± {self._tolerance_n:g} N,"
        force = f"  {0.0 if force_n is None else force_n:6.3f} N "
        after = f"{target} limit {limit_n:g} N"
        room = width - len(force) - len(after) - 1
        bar = force_bar(force_n, target_n, limit_n=limit_n, width=room)
        place = "" if self._height_m is None else f"   z {self._height_m * 1e3:.3f} mm"
        left_s = self._left.seconds(time.monotonic_ns())
        left = "" if left_s is None else f"   about {clock(left_s)} left"
        when_and_where = f"{left}{place}".lstrip()
        lines = (f"  {self._phase}   {trial}", f"{force}{bar}{after}", f"  {when_and_where}")
        texts = [Text(line, no_wrap=True, overflow="crop") for line in (*lines, f"  {HOW_TO_STOP}")]
        texts[-1].stylize("bold")
        return Group(*texts)


def _ended(event: JournalEvent) -> str:
    detail = event.detail
    force, depth = detail.get("force_measured_n"), detail.get("depth_measured_m")
    text = f"  {detail['outcome']}"
    if force is not None:
        text += f": mean {force:.4f} N"
    if depth is not None:
        text += f" at {depth * 1e3:.3f} mm below contact"
    if detail.get("reason"):
        text += f" ({detail['reason']})"
    return text


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
    """Return a time in words."""
    whole = round(seconds)
    return f"{whole} s" if whole < 60 else f"{whole // 60} min {whole % 60:02d} s"
