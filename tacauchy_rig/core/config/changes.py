"""What may be changed in a run that has begun: its devices, and what stops it.

Everything else is what the run is. Trials under two targets, indenters or protocols in one folder
would be reported as one experiment.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tacauchy_rig.core.config.load import check_config, leaves, nest, parse_override, with_defaults
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import ConfigError

OF_DEVICES = (
    "robot.host",
    "robot.connect_timeout",
    "robot.force_sign",
    "force_sensor.port",
    "force_sensor.connect_timeout",
    "camera.device",
    "camera.connect_timeout",
    "emulation.robot_host",
)
LIMITS = "limits."


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A field of a begun run that is another now; values as they are written."""

    field: str
    old: Any
    new: Any

    def __str__(self) -> str:
        return f"{self.field} = {self.new}, before: {self.old}"


def resumed_config(
    written: Mapping[str, Any], overrides: Sequence[str]
) -> tuple[RigConfig, tuple[Change, ...]]:
    """Return the configuration that a run goes on with, and what is changed in it.

    It is pressed with, so ceilings and rules are asked again.

    Args:
        written: What the run was recorded with, by dotted field.
        overrides: ``table.field=value`` from the command line.

    Raises:
        ConfigError: A field that a begun run keeps, or a value that is no longer allowed.
    """
    before = with_defaults(written)
    given = [pair for text in overrides for pair in leaves(parse_override(text))]
    if kept := [field for field, _ in given if not _is_changeable(field)]:
        raise ConfigError(
            "\n".join(
                f"{field}: is what the run is, and its trials would no longer be one experiment"
                for field in kept
            ),
            remedy="start a new run with it; a begun one takes limits.* and "
            + ", ".join(OF_DEVICES),
        )
    config = check_config(nest({**before, **dict(given)}), defaulted=frozenset())
    changes = (Change(field=name, old=before.get(name), new=value) for name, value in given)
    return config, tuple(change for change in changes if change.old != change.new)


def _is_changeable(field: str) -> bool:
    return field in OF_DEVICES or field.startswith(LIMITS)
