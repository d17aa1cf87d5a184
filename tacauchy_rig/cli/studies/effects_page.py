"""What ``effects-check`` found, as lines and as a Markdown page."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from sim.scene.scene import Effect
from sim.studies.effects_check.check import EffectCheck, Omission

_WIDTH = 100
_HEAD = """\
| scene | tolerance | left out | expected | found | time saved | |
|---|---|---|---|---|---|---|"""
_PRESSED = (
    "Every scene is pressed twice: under its plan, and with everything on that it can have. "
    "**Expected** is the plan's estimate of what leaving out costs, **found** the difference of "
    "the two presses: of the force as a vector over its size, or of the depth where a force is "
    "asked for. **Time saved** is the processor's time with everything on over that under the "
    "plan, setting up included; kernels were compiled and loaded before."
)
_ABSENT = (
    "Symmetry saves work instead of adding to it, so it is on in both presses; where it counts as "
    "left out, the second press is of the whole pad. Self-contact is not simulated, and images, "
    "shadows and markers are drawn after the mechanics and change no force: none of them is in "
    "the table. Preset `paper` is not either: its linear tetrahedra are asked for, not planned."
)
_ONE_BY_ONE = (
    "What a plan keeps although it could be left out, taken out of it one at a time: what was "
    "expected of that, what came of it, and the processor's time with it over that without. An "
    "effect is **needless** where the scene would have stayed within its tolerance without it."
)


def line(check: EffectCheck) -> str:
    """Say in one line what came of a scene."""
    verdict = "ok" if check.passed else "MISSED"
    text = (
        f"{check.case.name:22} {verdict:6} {check.difference:9.2e} of {check.plan.tolerance:.2e}, "
        f"{check.time_ratio:5.1f} times the time with {_names(check.added)} on"
    )
    apart = "; ".join(f"{effect.value} apart: {why}" for effect, why in check.left_apart)
    return f"{text} ({apart})" if apart else text


def markdown(checks: Sequence[EffectCheck], *, command: str, case_count: int) -> str:
    """Return the page.

    Args:
        case_count: Scenes in the catalogue, so that a page of a part says so.
    """
    missed = [check.case.name for check in checks if not check.passed]
    parts = [
        "# Effects: plans against everything on",
        f"Made by `{command}`.",
        _PRESSED,
        _ABSENT,
        f"{len(checks)} of {case_count} scenes; "
        + (f"missed: {', '.join(missed)}." if missed else "all within their tolerance."),
        "\n".join([_HEAD, *(_row(check) for check in checks)]),
        "## The scenes",
        "\n".join(f"- **{check.case.name}**: {check.case.shows}." for check in checks),
        *_apart(checks),
        "## What was kept",
        _ONE_BY_ONE,
        "\n".join(_kept(checks)),
    ]
    return "\n\n".join(_wrapped(part) for part in parts) + "\n"


def _row(check: EffectCheck) -> str:
    return (
        f"| {check.case.name} | {_percent(check.plan.tolerance)} | {_names(check.added)} "
        f"| {_percent(check.plan.estimated_error)} | {_percent(check.difference)} "
        f"| {check.time_ratio:.1f} x | {'within' if check.passed else '**missed**'} |"
    )


def _apart(checks: Sequence[EffectCheck]) -> Iterator[str]:
    """Say what could not be switched on besides the rest."""
    reasons: dict[tuple[Effect, str], list[str]] = {}
    for check in checks:
        for effect, why in check.left_apart:
            reasons.setdefault((effect, why), []).append(check.case.name)
    if reasons:
        yield "Not everything can be combined:"
        yield "\n".join(
            f"- {effect.value} is off in both presses of {', '.join(names)}: {why}."
            for (effect, why), names in reasons.items()
        )


def _kept(checks: Sequence[EffectCheck]) -> Iterator[str]:
    yield "| scene | effect | expected | found | time | |"
    yield "|---|---|---|---|---|---|"
    for check in checks:
        for omission in check.omissions:
            yield _kept_row(check, omission)


def _kept_row(check: EffectCheck, omission: Omission) -> str:
    verdict = "needless" if omission in check.needless else "needed"
    return (
        f"| {check.case.name} | {omission.effect.value} | {_percent(omission.estimated)} "
        f"| {_percent(omission.measured)} | {omission.time_ratio:.1f} x | {verdict} |"
    )


def _names(effects: Sequence[Effect]) -> str:
    return ", ".join(effect.value for effect in effects) or "nothing"


def _percent(value: float) -> str:
    return f"{float(f'{value * 100:.2g}'):g} %"


def _wrapped(part: str) -> str:
    if part.startswith(("|", "#", "-")):
        return part
    return textwrap.fill(part, width=_WIDTH, break_long_words=False, break_on_hyphens=False)
