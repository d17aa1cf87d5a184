"""Some of many, by the shell patterns of ``--only``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fnmatch import fnmatch
from typing import TypeVar

from tacauchy_rig.core.errors import ConfigError

Item = TypeVar("Item")


def selected(
    items: Sequence[Item],
    patterns: Sequence[str],
    *,
    names: Callable[[Item], Sequence[str]],
    kind: str,
    remedy: str = "",
) -> tuple[Item, ...]:
    """Return the items of which a pattern matches a name, in their order; all without patterns.

    Args:
        names: Of an item; a list of what there is shows the first.
        kind: What an item is called in messages.
        remedy: Instead of that list.

    Raises:
        ConfigError: A pattern matches nothing.
    """
    found = {
        pattern: [item for item in items if any(fnmatch(name, pattern) for name in names(item))]
        for pattern in patterns
    }
    for pattern, fitting in found.items():
        if not fitting:
            known = "; ".join(names(item)[0] for item in items)
            raise ConfigError(
                f"--only {pattern!r}: no such {kind}", remedy=remedy or f"choose among {known}"
            )
    if not patterns:
        return tuple(items)
    return tuple(item for item in items if any(item in fitting for fitting in found.values()))
