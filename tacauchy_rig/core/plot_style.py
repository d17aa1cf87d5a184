"""How every figure looks, how it is saved, and the mark of a dry run.

IEEE column widths, Times-like type, and colours that survive colour-blind eyes and grey print.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib import rc_params_from_file
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from tacauchy_rig.core.store.atomic_write import writing

COLUMN_IN = 3.5
PAGE_IN = 7.16
MARK_STRIP_IN = 0.17
PRINT_DPI = 300
SCREEN_DPI = 200

# Okabe and Ito, 2008: distinguishable with the common colour-vision deficiencies.
BLUE, ORANGE, GREEN, PURPLE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9"
INK, GREY, LIGHT = "#222222", "#777777", "#D9D9D9"

STYLE: Any = dict(
    rc_params_from_file(Path(__file__).with_name("figures.mplstyle"), use_default_template=False)
)


FRAMED_STYLE: Any = STYLE | {"axes.spines.top": True, "axes.spines.right": True}
"""For maps and images, which have a frame all around."""


def new_figure(
    width_in: float, height_in: float, *, marks: Sequence[str], pad_in: float = 0.04
) -> Figure:
    """Create a figure [inch]; marks, such as a dry run's, get a strip of their own at the top."""
    height = height_in + (MARK_STRIP_IN if marks else 0.0)
    layout = ConstrainedLayoutEngine(
        rect=(0, 0, 1, height_in / height), w_pad=pad_in, h_pad=pad_in, wspace=0.02, hspace=0.02
    )
    figure = Figure(figsize=(width_in, height), layout=layout)
    if marks:
        figure.text(
            1.0 - 0.03 / width_in,
            1.0 - 0.03 / height,
            "; ".join(marks),
            ha="right",
            va="top",
            fontsize=6.5,
            fontweight="bold",
            color=ORANGE,
        )
    return figure


def save_figure(
    figure: Figure, folder: Path, name: str, *, page_folder: Path | None = None
) -> list[Path]:
    """Write ``name.pdf`` and ``name.png`` and return them; equal figures give equal files.

    Args:
        page_folder: Put a smaller PNG for a page on a screen there besides.

    Raises:
        RecordError: A file cannot be written.
    """
    if layout := figure.get_layout_engine():
        layout.execute(figure)
    figure.set_layout_engine(None)  # with one, be it "none", each file would be drawn twice
    # No date and no version, which would make each file another one.
    quick: Any = {"metadata": {"Software": None}, "pil_kwargs": {"compress_level": 1}}
    wanted: list[tuple[Path, Any]] = [
        (folder / f"{name}.pdf", {"metadata": {"CreationDate": None, "Producer": None}}),
        (folder / f"{name}.png", quick),
    ]
    if page_folder is not None:
        wanted.append((page_folder / f"{name}.png", quick | {"dpi": SCREEN_DPI}))
    for path, options in wanted:
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(path, **{"dpi": PRINT_DPI, **options})
    return [path for path, _ in wanted]


def letter(axes: Axes, text: str) -> None:
    """Name a panel, such as (a), above its left end."""
    axes.set_title(text, loc="left", fontsize=8)
