"""What ``objects`` found, as a Markdown page."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from sim.scene.scene import Preset
from sim.studies.objects.runs import DEPTH_M, ObjectPress
from sim.studies.objects.shapes import OBJECTS

_WIDTH = 100
_PRESSED = f"Five bodies, from sharp edges to smooth curves, pressed {DEPTH_M * 1e3:g} mm deep"
_FIGURE = "![Five objects, and what they leave in each sensor](images/five_objects.png)"
_DRAWN = (
    "Above, the bodies as their meshes are, seen from below at a slant. Under them, for each "
    "sensor, how far the gel is pushed in, with F_z, and the tactile image: the lamps of the "
    "sensor's file over an even no-contact frame, as nobody has calibrated them, with shadows "
    "where that file asks for them. Every picture shows the same piece of gel, as much as the "
    "camera with the narrowest view sees."
)
_TEETH = (
    "The fine teeth along the straight edges are the mesh's: preset fast has edges of about "
    "0.2 mm there, three to six pixels."
)
_COLUMNS = ("sensor", "object", "F_z [N]", "highest pixel above the object [um]", "time [s]")


def markdown(runs: Sequence[Sequence[ObjectPress]], *, command: str, preset: Preset) -> str:
    """Return the page.

    Args:
        runs: Of each sensor the objects in one order.
        command: What makes the page.
    """
    presses = [run for sensor in runs for run in sensor]
    minutes = sum(run.processor_s for run in presses) / 60.0
    parts = [
        "# Five objects",
        f"Made by `{command}`.",
        f"{_PRESSED}; preset {preset}, {minutes:.0f} minutes of one processor for all.",
        _FIGURE,
        f"{_DRAWN} {_TEETH}" if preset is Preset.FAST else _DRAWN,
        "\n".join(_bodies()),
        "`sim/studies/objects/shapes.py` makes their triangles from formulas.",
        "\n".join(_rows(presses)),
        "No pixel of a height map may lie above its body. Times are the processor's.",
    ]
    return "\n\n".join(_wrapped(part) for part in parts) + "\n"


def _bodies() -> Iterator[str]:
    yield "| object | what it is |"
    yield "|---|---|"
    for name, make in OBJECTS.items():
        text = (make.__doc__ or "").strip().removeprefix("Return ").rstrip(".")
        yield f"| {name} | {text} |"


def _rows(presses: Sequence[ObjectPress]) -> Iterator[str]:
    yield "| " + " | ".join(_COLUMNS) + " |"
    yield "|---" * len(_COLUMNS) + "|"
    for run in presses:
        above = 0.0 if run.highest_over_m < 1e-12 else run.highest_over_m * 1e6
        yield (
            f"| {run.sensor} | {run.name} | {run.force_n:.3f} | {above:.3g} | "
            f"{run.processor_s:.0f} |"
        )


def _wrapped(part: str) -> str:
    if part.startswith(("|", "#", "!")):
        return part
    return textwrap.fill(part, width=_WIDTH, break_long_words=False, break_on_hyphens=False)
