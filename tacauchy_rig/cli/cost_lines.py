"""What a force is worth, and what other settings would cost, in the words of every command."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tacauchy_rig.run import Alternative


def cost_lines(
    error_relative: float | None, basis: str, cost: str, others: Sequence[Alternative]
) -> Iterator[str]:
    """Return lines on the believed error, the cost, and the next cheaper and better settings.

    Args:
        basis: How the error is known, or why not.
        cost: Of the settings used.
    """
    believed = "not known" if error_relative is None else f"{error_relative:.1%}"
    yield f"force error believed to be {believed}: {basis}"
    yield f"cost       {cost}"
    for other in others:
        yield f"{other.role:10} {other}"
    if not others:
        yield "no neighbours: nothing was measured with these settings"
