"""Progress of a session: a few live lines on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rich.live import Live

from protocols.trials.time_left import TimeLeft
from protocols.trials.trial import PlannedTrial
from tacauchy_rig.app.cli.live_lines import live_lines
from tacauchy_rig.app.cli.output import console, say
from tacauchy_rig.app.cli.page import open_in_browser
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.expected_press import ExpectedPress
from tacauchy_rig.core.run import JournalEvent, Outcome

PROGRESS = "progress"

PHASES = {
    "preflight": "checking that everything answers",
    "air-press": "pressing the air above the gel first",
    "home": "going home",
    "tare": "weighing nothing, to find zero",
    "reference": "taking the picture without contact",
    "approach": "coming down to the gel",
    "search": "searching for contact",
    "press": "pressing to the target",
    "dwell": "holding the force, taking pictures",
    "sway": "going up and down a little, which tells delays",
    "retract": "letting go",
    "drift-check": "weighing nothing again",
    "verdict": "judging",
    "fault": "making the arm safe",
}


_JUDGED = (Outcome.PASSED, Outcome.FAILED)
"""Outcomes of attempts that ran to their end; what cut another off is an event of its own."""


class SessionProgress:
    """Says what the arm is doing and what the gel feels; a context.

    Args:
        config: Targets, limits and speeds.
        plan: What is left to do.
        expected: What a press should give; None where nobody knows.
        open_page: Whether a browser is opened on the operator's page.
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
        self._soft_force_n = config.limits.soft_force
        self._target_n: float | None = None
        self._trial = 0
        self._left = TimeLeft(config, plan, expected)
        self._live = Live(console=console, refresh_per_second=8, transient=True)
        self._phase = ""
        self._force_n: float | None = None
        self._height_m: float | None = None

    def __enter__(self) -> SessionProgress:
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
            case _:
                pass

    def _enter(self, event: JournalEvent) -> None:
        name = str(event.detail.get("phase", ""))
        self._phase = PHASES.get(name, name)
        if console.is_terminal:
            self._update(event)
        elif name != "fault":  # by then the arm is safe, and the next line says what it was
            say(f"  {self._phase}")

    def _update(self, event: JournalEvent) -> None:
        if not console.is_terminal:
            return
        detail = event.detail
        # An event of another kind says neither; what was said last still stands.
        self._force_n = detail.get("force_n", self._force_n)
        self._height_m = detail.get("height_m", self._height_m)
        lines = live_lines(
            step=self._phase,
            trial=f"trial {self._trial} of {self._trial_count}" if self._trial else "",
            force_n=self._force_n,
            target_n=self._target_n,
            tolerance_n=self._tolerance_n,
            limit_n=self._soft_force_n,
            height_m=self._height_m,
            left_s=self._left.seconds(time.monotonic_ns()),
            width=console.width,
        )
        self._live.update(lines)


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
