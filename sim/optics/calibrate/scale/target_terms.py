"""Scale targets as text: ``charuco:columns=8,rows=6,square=2mm,marker=1.5mm``."""

from __future__ import annotations

from sim.optics.calibrate.scale.target import ArucoTarget, CharucoTarget, DotTarget, ScaleTarget
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.quantities import Dimension, parse_quantity

_LENGTHS = {"charuco": ("square", "marker"), "aruco": ("marker", "gap"), "dots": ("pitch",)}
_EXAMPLES = {
    "charuco": "charuco:columns=8,rows=6,square=2mm,marker=1.5mm,dictionary=4X4_50",
    "aruco": "aruco:columns=5,rows=4,marker=2mm,gap=0.5mm,dictionary=4X4_50",
    "dots": "dots:columns=7,rows=5,pitch=2mm",
}
_DEFAULT_DICTIONARY = "4X4_50"


def parse_target(text: str) -> ScaleTarget:
    """Read a target.

    Raises:
        ConfigError: No such target, or a number that is missing, unknown or without its unit.
    """
    kind, _, terms = text.partition(":")
    if kind not in _LENGTHS:
        raise ConfigError(
            f"--target {text!r}: no such target", remedy=f"write {', '.join(_EXAMPLES.values())}"
        )
    given = dict(part.partition("=")[::2] for part in terms.split(",") if part)
    needed = {"columns", "rows", *_LENGTHS[kind]}
    optional = set() if kind == "dots" else {"dictionary"}
    wrong = sorted((needed - set(given)) | (set(given) - needed - optional))
    if wrong:
        raise ConfigError(
            f"--target {kind}: missing or unknown: {', '.join(wrong)}",
            remedy=f"write {_EXAMPLES[kind]}",
        )
    columns, rows = (_count(given[key], f"--target {key}") for key in ("columns", "rows"))
    first, *rest = (_length(given[key], f"--target {key}") for key in _LENGTHS[kind])
    dictionary = given.get("dictionary", _DEFAULT_DICTIONARY)
    if kind == "dots":
        return DotTarget(columns=columns, rows=rows, pitch_m=first)
    if kind == "aruco":
        return ArucoTarget(
            columns=columns, rows=rows, marker_m=first, gap_m=rest[0], dictionary=dictionary
        )
    if not rest[0] < first:
        raise ConfigError(
            f"--target charuco: marker {given['marker']} is not smaller than square "
            f"{given['square']}",
            remedy="give both as printed",
        )
    return CharucoTarget(
        columns=columns, rows=rows, square_m=first, marker_m=rest[0], dictionary=dictionary
    )


def _count(text: str, field: str) -> int:
    if not text.isdigit() or int(text) < 2:
        raise ConfigError(f"{field} {text!r} is not a whole number above 1", remedy="count again")
    return int(text)


def _length(text: str, field: str) -> float:
    value = parse_quantity(text, dimension=Dimension.LENGTH, field=field)
    if not value > 0.0:
        raise ConfigError(f"{field} {text!r} is not positive", remedy="measure the print")
    return value
