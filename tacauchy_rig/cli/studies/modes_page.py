"""What ``modes`` found, as a Markdown page."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from sim.scene.indenter import describe
from sim.scene.scene import Preset
from sim.studies.modes.criteria import FRICTION
from sim.studies.modes.runs import BALL_REFINEMENT, ModeRun

_WIDTH = 100
_DRAWN = (
    "Colours are stress in the plane y = 0, pressure and the tangential traction's size; the last "
    "column is the shear that a mode is about, xz of press and slide and yz of twist. Arrows are "
    "the tangential traction on the gel, as long as the root of its size; the indenter feels the "
    "opposite. A cross marks the centre of pressure."
)
_TIMES = (
    "Times are the processor's, setting up included; a press that is gone on from is counted once, "
    "in its own row."
)
_MOVED = (
    "![Press, slide and twist: stress in a section, pressure, tangential traction and shear]"
    "(images/contact_modes.png)"
)
_PRESSED = (
    "![A ball on three sensors: section, mesh, pressure and tangential traction]"
    "(images/three_sensors.png)"
)
_FORCES = (
    "Forces act on the gel and are split along the indenter's normals. **F_n** is the size of the "
    "normal forces' resultant, **T** that of the tangential forces' (on a rounded edge it has a "
    "part along z, which counts to F_z), **sum t** the sum of the tangential forces' sizes, "
    "**sliding** that sum over mu times the sum of the normal forces' sizes: 1 where every point "
    "slides. **Centre** is the centre of pressure's distance from the indenter's axis along x."
)
_DIRECTIONS = (
    "Directions are judged at the mesh's vertices, where the paper has its force fields: **radial**"
    " and **around** are the mean size of the cosine between the tangential force and the way from "
    "the axis, or around it, weighted by the force's size; **inward** is the weighted mean of the "
    "cosine with the way towards the axis. **Radial, by point** is the same as radial over the "
    "contact points, of which a face has twelve, more than its displacement can obey: where the "
    "gel sticks, their tractions scatter about those of the vertices and cancel within a face."
)
_COLUMNS = (
    "sensor, mode",
    "F_n [N]",
    "T [N]",
    "sum t [N]",
    "sliding",
    "centre [mm]",
    "radial",
    "inward",
    "around",
    "radial, by point",
    "time [s]",
)


def markdown(
    moved: Sequence[ModeRun], pressed: Sequence[ModeRun], *, command: str, preset: Preset
) -> str:
    """Return the page.

    Args:
        moved: A punch's modes on one sensor.
        pressed: One press on several sensors.
        command: What makes the page.
    """
    runs = [*moved, *pressed]
    ball = f"{describe(pressed[0].indenter)}, {pressed[0].travel}"
    missed = [run.title for run in runs if not run.passed]
    parts = [
        "# Contact modes",
        f"Made by `{command}`.",
        f"Preset {preset.value}, friction {FRICTION:g}; {_met(missed)}",
        "## A punch on one sensor",
        f"{describe(moved[0].indenter)}, {moved[0].sensor.title}.",
        _MOVED,
        _DRAWN,
        "\n".join(_criteria(moved)),
        "## A ball on three sensors",
        f"{ball}, edges {BALL_REFINEMENT:g} times finer than the preset's.",
        _PRESSED,
        "\n".join(_criteria(pressed)),
        "## Signatures",
        _FORCES,
        _DIRECTIONS,
        _TIMES,
        "\n".join(_signatures(runs)),
    ]
    return "\n\n".join(_wrapped(part) for part in parts) + "\n"


def _met(missed: Sequence[str]) -> str:
    return f"missed: {'; '.join(missed)}." if missed else "every criterion is met."


def _criteria(runs: Sequence[ModeRun]) -> Iterator[str]:
    yield "| run | criterion | measured | limit | |"
    yield "|---|---|---|---|---|"
    for run in runs:
        for criterion in run.criteria:
            verdict = criterion.verdict
            yield (
                f"| {run.sensor.title}, {run.name}, {run.travel} | {criterion.name} "
                f"| {criterion.measured:.4g} | {criterion.limit} "
                f"| {verdict if verdict == 'ok' else f'**{verdict}**'} |"
            )


def _signatures(runs: Sequence[ModeRun]) -> Iterator[str]:
    yield "| " + " | ".join(_COLUMNS) + " |"
    yield "|---" * len(_COLUMNS) + "|"
    for run in runs:
        found = run.signature
        size = sum(value**2 for value in found.tangential_n) ** 0.5
        cells = (
            f"{run.sensor.title}, {run.name}",
            f"{found.normal_size_n:.4f}",
            f"{size:.4f}",
            f"{found.tangential_sum_n:.4f}",
            f"{found.sliding_friction / FRICTION:.4f}",
            f"{found.centre_m[0] * 1e3:.4f}",
            f"{found.radial_share:.4f}",
            f"{found.inward_share:.4f}",
            f"{found.circumferential_share:.4f}",
            f"{found.radial_share_points:.3f}",
            f"{run.processor_s:.0f}",
        )
        yield "| " + " | ".join(cells) + " |"


def _wrapped(part: str) -> str:
    if part.startswith(("|", "#", "!")):
        return part
    return textwrap.fill(part, width=_WIDTH, break_long_words=False, break_on_hyphens=False)
