"""All hard cases, in the order of their numbers."""

from __future__ import annotations

from collections.abc import Collection

from sim.studies.hard_cases.case import HardCase
from sim.studies.hard_cases.rows import (
    compression,
    footprints,
    impacts,
    materials,
    precision,
    presses,
    refinement,
    rims,
    sliding,
    starts,
    time_steps,
    units,
)
from tacauchy_rig.errors import ConfigError

# A module that brings rows is added here and nowhere else.
_MODULES = (
    compression,
    footprints,
    impacts,
    materials,
    precision,
    presses,
    refinement,
    rims,
    sliding,
    starts,
    time_steps,
    units,
)


def all_cases() -> tuple[HardCase, ...]:
    """Return every case, sorted by number."""
    cases = [case for module in _MODULES for case in module.CASES]
    return tuple(sorted(cases, key=lambda case: case.number))


def select_cases(rows: Collection[int]) -> tuple[HardCase, ...]:
    """Return the cases of these numbers; all of them where none is given.

    Raises:
        ConfigError: There is no case of such a number.
    """
    cases = all_cases()
    unknown = sorted(set(rows) - {case.number for case in cases})
    if unknown:
        known = ", ".join(str(case.number) for case in cases)
        raise ConfigError(
            f"--rows: there is no hard case {', '.join(map(str, unknown))}",
            remedy=f"choose among {known}",
        )
    return tuple(case for case in cases if not rows or case.number in rows)
