"""The fault table as Markdown, for operators."""

from __future__ import annotations

import os
import platform
import textwrap
from collections.abc import Iterator, Sequence

from tacauchy_rig import __version__
from tacauchy_rig.config.model import RigConfig
from tacauchy_rig.fault_table.cases import Moment
from tacauchy_rig.fault_table.observation import KILLED_EXIT_CODE, Observation

_TITLES = {
    "robot": "The robot fails",
    "force_sensor": "The force sensor fails",
    "camera": "The camera fails",
    "kill": "A process of the run is killed (`kill -9`)",
}

_MEANING = {
    "robot:freeze": "the controller answers nobody any more; its arm goes on",
    "robot:drop": "every connection to the controller breaks, new ones are refused",
    "robot:delay": "the network holds everything up by 200 ms, both ways",
    "robot:protective-stop": "a protective stop",
    "robot:emergency-stop": "an emergency stop at the pendant",
    "robot:stall": "the arm stands still whatever it is told",
    "force_sensor:freeze": "the same values in every frame",
    "force_sensor:drop": "half of the frames never come",
    "force_sensor:garble": "bytes of 30 % of the frames are damaged",
    "force_sensor:delay": "every frame comes 200 ms late",
    "force_sensor:unplug": "the serial port is gone",
    "force_sensor:saturate": "Fz reads full scale",
    "force_sensor:stall": "the box is silent, its port stays",
    "camera:freeze": "the same image again and again",
    "camera:drop": "30 % of the frames never come",
    "camera:garble": "30 % of the frames are cut short and damaged",
    "camera:delay": "every frame comes 500 ms late",
    "camera:unplug": "the stream ends, nobody answers at its address",
    "camera:saturate": "far too much light, every pixel near white",
    "camera:stall": "no more frames, the connection stays",
    "kill:supervisor": "the program on the operator's terminal",
    "kill:control": "owns the arm and the force sensor",
    "kill:camera": "owns the camera",
    "kill:recorder": "owns the disk",
}

_MESSAGES = (
    "**Messages** are force samples, arm states, events and frames. Readable are those found in "
    "the recording and its spill files before any repair; after `resume` all of them were found "
    "again. Between fault and `resume` the device was mended, or the stop unlocked, and nobody "
    "moved the arm."
)

WIDTH = 100

_HEAD = """\
| when | the arm | true force | messages acknowledged / readable | the operator was told \
| exit | `resume` |
|---|---|---|---|---|---|---|"""


def summary_line(seen: Sequence[Observation]) -> str:
    """Return the whole table in one paragraph."""
    stopped = [s for s in seen if not s.went_on and s.arm.stopped_after_s is not None]
    worst_stop = max(stopped, key=lambda s: s.arm.stopped_after_s or 0.0, default=None)
    worst_rise = max(stopped, key=lambda s: s.force_rise_n, default=None)
    lost = sum(max(s.kept.lost_count, s.kept_after_resume.lost_count) for s in seen)
    resumed = sum(1 for s in seen if s.resumed and s.resumed[-1].exit_code == 0)
    bad = sum(1 for s in seen if s.problems)
    parts = [f"{len(seen)} cases", f"{len(stopped)} ended the run, {_went_on(seen)} did not"]
    if worst_stop is not None and worst_rise is not None:
        milliseconds = (worst_stop.arm.stopped_after_s or 0.0) * 1e3
        parts.append(f"slowest stop {milliseconds:.0f} ms ({worst_stop.name})")
        parts.append(f"largest rise {worst_rise.force_rise_n:.2f} N ({worst_rise.name})")
    parts += [f"acknowledged messages lost: {lost}", f"resumed to the end: {resumed}"]
    return f"{'; '.join(parts)}; cases that ended in motion, a hang, silence or a loss: {bad}."


def markdown(
    seen: Sequence[Observation], *, command: str, config: RigConfig, case_count: int
) -> str:
    """Return the document.

    Args:
        seen: What was observed, in the order of the table.
        command: What made it.
        config: Of the runs.
        case_count: How many cases there are.
    """
    lines = ["# What happens when something fails", "", f"**{summary_line(seen)}**", ""]
    if len(seen) < case_count:
        lines += [f"{len(seen)} of {case_count} cases are in this table.", ""]
    lines += [_preface(seen, command, config), ""]
    for group, title in _TITLES.items():
        rows = [s for s in seen if s.cause.partition(":")[0] == group]
        if rows:
            lines += [f"## {title}", "", *_tables(rows)]
    return "\n".join(lines).rstrip() + "\n"


def _preface(seen: Sequence[Observation], command: str, config: RigConfig) -> str:
    paragraphs = (_how_it_was_made(seen, command, config), _what_is_true(config), _MESSAGES)
    return "\n\n".join(
        textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)
        for text in paragraphs
    )


def _how_it_was_made(seen: Sequence[Observation], command: str, config: RigConfig) -> str:
    moments = ", ".join(f"{moment.delay_s:g} s into the {moment.value}" for moment in Moment)
    repeated = sum(1 for s in seen if s.tries > 1)
    text = (
        f"Written by `{command}` (version {__version__}, Linux on {platform.machine()}, "
        f"{os.cpu_count()} processors). Nothing real has been broken yet: robot, force sensor and "
        "camera are emulated, in processes of their own that survive the run; everything else is "
        "the program that a laboratory uses, with its real drivers. Each case is one press to "
        f"{config.protocol.force_targets[0]:g} N that is disturbed {moments}; the first of these "
        "is just above the gel."
    )
    if repeated:
        cases = "1 case was" if repeated == 1 else f"{repeated} cases were"
        text += (
            f" {cases} begun again, because on a busy computer the run had ended before the moment "
            "of its fault."
        )
    return text


def _what_is_true(config: RigConfig) -> str:
    limits, robot = config.limits, config.robot
    return (
        "**The arm** and **true force** are the truth of the emulated arm and gel, not what the "
        "run measured. The time counts from the fault until the arm stood still for 0.1 s. It "
        "holds the time in which the fault is noticed, so it follows the limits, which are patient "
        f"where a dozen processes share a computer: force {_ms(limits.stale_force)}, robot "
        f"{_ms(limits.stale_robot)}, image {_ms(limits.stale_image)}, watchdog of the controller "
        f"{_ms(1.0 / robot.watchdog)}; the example for a rig sets 50, 100, 200 and 100 ms. An arm "
        f"that does not follow its commands is given {_ms(limits.no_motion)} on both. The "
        "rise is the largest true force after the fault, above the one at the fault; speeds are "
        f"{robot.search_speed * 1e3:g} mm/s in the search and up to {robot.press_speed * 1e3:g} "
        "mm/s in the press."
    )


def _ms(duration_s: float) -> str:
    return f"{duration_s * 1e3:.0f} ms"


def _tables(rows: Sequence[Observation]) -> Iterator[str]:
    for cause in dict.fromkeys(row.cause for row in rows):
        yield f"**{cause}**: {_MEANING[cause]}."
        yield ""
        yield _HEAD
        yield from (_row(row) for row in rows if row.cause == cause)
        yield ""


def _row(seen: Observation) -> str:
    cells = (
        seen.name.partition("@")[2],
        _arm(seen),
        _force(seen),
        _kept(seen),
        _told(seen),
        _exit(seen),
        _resume(seen),
    )
    return "| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |"


def _arm(seen: Observation) -> str:
    arm = seen.arm
    problems = "".join(f"; **{problem}**" for problem in seen.problems)
    if seen.went_on:
        return f"went on, and stands at home{problems}"
    if arm.stopped_after_s is None:
        return f"did not stop{problems}"
    text = f"stood still after {arm.stopped_after_s * 1e3:.0f} ms"
    if arm.descended_m >= 1e-6:
        text += f", {arm.descended_m * 1e3:.3f} mm further down"
    if arm.raised_after_m >= 1e-6:
        text += f", then went up {arm.raised_after_m * 1e3:.2f} mm"
    return text + problems


def _force(seen: Observation) -> str:
    if seen.went_on:
        return f"{seen.force_at_fault_n + seen.force_rise_n:.2f} N at most, as planned"
    return f"+{seen.force_rise_n:.2f} N (from {seen.force_at_fault_n:.2f} N)"


def _kept(seen: Observation) -> str:
    kept = seen.kept
    text = f"{sum(kept.acknowledged.values())} / {sum(kept.readable.values())}"
    return f"{text}, **{kept.lost_count} lost**" if kept.lost_count else f"{text}, none lost"


def _told(seen: Observation) -> str:
    first = seen.told.partition("\n")[0].removeprefix("error: ")
    if seen.exit_code == KILLED_EXIT_CODE:
        return f"nothing (killed); the journal says: {first}" if first else "nothing (killed)"
    if seen.went_on:
        told = "; ".join(seen.told.splitlines())
        return f"{told}{_streams(seen)}".strip()
    return first


def _streams(seen: Observation) -> str:
    rates = seen.measured
    if not rates:
        return ""
    parts = [
        f"{name} {rates.get(f'{name}_rate_hz', 0.0):.1f} Hz, "
        f"{rates.get(f'{name}_lost_count', 0.0):.0f} counted as lost, "
        f"longest gap {rates.get(f'{name}_gap_max_ms', 0.0):.0f} ms"
        for name in ("force", "image")
    ]
    return f" ({'; '.join(parts)})"


def _exit(seen: Observation) -> str:
    if seen.exit_code < 0:
        return f"killed ({128 - seen.exit_code} in a shell)"
    return str(seen.exit_code)


def _resume(seen: Observation) -> str:
    if not seen.resumed or seen.resumed[-1].exit_code != 0:
        return "**not finished**"
    return "finished" if len(seen.resumed) == 1 else f"finished at try {len(seen.resumed)}"


def _went_on(seen: Sequence[Observation]) -> int:
    return sum(1 for s in seen if s.went_on)
