"""All hard cases: what measures each, and what ``criteria.toml`` asks of it."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Collection
from importlib import resources

from sim.studies.hard_cases import (
    compression,
    dynamics,
    materials,
    places,
    precision,
    presses,
    refinement,
    sliding,
    starts,
    units,
)
from sim.studies.hard_cases.case import HardCase, Outcome
from tacauchy_rig.core.errors import ConfigError

_MEASURES: dict[int, Callable[[], Outcome]] = {
    1: starts.degenerate_starts,
    2: starts.random_start,
    3: materials.nearly_incompressible,
    4: compression.deep_presses,
    5: places.moved_rim,
    6: dynamics.time_steps,
    7: materials.slivers,
    8: materials.stiff_layers,
    9: sliding.stick_slip,
    10: dynamics.impact,
    11: sliding.torsion,
    12: units.scaled_units,
    13: precision.single_precision,
    14: presses.no_contact,
    15: starts.penetrating_start,
    16: places.off_the_pad,
    17: refinement.consistency_and_order,
    18: presses.force_balance,
    19: presses.repeatable,
}


def all_cases() -> tuple[HardCase, ...]:
    """Return every case, in the order of the page."""
    text = resources.files("sim.studies.hard_cases").joinpath("criteria.toml").read_text("utf-8")
    stated = tomllib.loads(text)
    return tuple(
        HardCase(number=number, measure=measure, **stated[str(number)])
        for number, measure in _MEASURES.items()
    )


def select_cases(numbers: Collection[int]) -> tuple[HardCase, ...]:
    """Return the cases of these numbers; all of them where none is given.

    Raises:
        ConfigError: There is no case of such a number.
    """
    unknown = sorted(set(numbers) - set(_MEASURES))
    if unknown:
        raise ConfigError(
            f"--rows: there is no hard case {', '.join(map(str, unknown))}",
            remedy=f"choose among {', '.join(map(str, _MEASURES))}",
        )
    return tuple(case for case in all_cases() if not numbers or case.number in numbers)
