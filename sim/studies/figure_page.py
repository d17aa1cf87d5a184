"""How the simulator's figures look on a page, and where they go."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from tacauchy_rig.errors import RecordError

PAGE_IN = 7.16
INK, STEEL = "#222222", "#C9CED6"
MM = 1e3
STYLE: Any = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 8,
    "axes.titlesize": 8,
    "figure.titlesize": 8.5,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.linewidth": 0.5,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "text.color": INK,
    # Type 42 embeds the fonts.
    "pdf.fonttype": 42,
}
_PRINT_DPI = 300
# For a page on a screen.
_SCREEN_DPI = 200


def save_figure(figure: Figure, folder: Path, page_folder: Path | None, name: str) -> list[Path]:
    """Write a figure as PDF and PNG; return the files.

    Args:
        page_folder: Put a smaller PNG there besides.

    Raises:
        RecordError: The files cannot be written.
    """
    wanted = {folder / f"{name}.pdf": _PRINT_DPI, folder / f"{name}.png": _PRINT_DPI}
    if page_folder is not None:
        wanted[page_folder / f"{name}.png"] = _SCREEN_DPI
    for path, dpi in wanted.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(path, dpi=dpi)
        except OSError as error:
            raise RecordError(
                f"{path}: cannot be written: {error.strerror}", remedy="give --out another folder"
            ) from error
    return list(wanted)
