"""Presses that a twin is timed on: unlike sensors, indenters and contacts."""

from __future__ import annotations

from dataclasses import dataclass

_BALL = ('indenter.kind="sphere"', 'indenter.diameter="8 mm"', 'indenter.fillet="0 mm"')
_SOFT = ('protocol.force_targets=["0.8 N", "2 N"]',)
_HARD = ('protocol.force_targets=["1.2556 N", "4.7332 N"]',)


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinScene:
    """A press by name, as changes of the default configuration."""

    name: str
    overrides: tuple[str, ...]


SCENES = (
    TwinScene(name="GelSight Mini, cylinder", overrides=_HARD),
    TwinScene(name="GelSight Mini, ball", overrides=(*_HARD, *_BALL)),
    TwinScene(
        name="GelSight Mini, cylinder, friction 0.5",
        overrides=(*_HARD, "replay.friction=0.5"),
    ),
    TwinScene(
        name="GelSight Mini, cylinder, tilted by 1 deg",
        overrides=(*_HARD, 'replay.tilt=["1 deg", "0 deg"]'),
    ),
    TwinScene(name="DIGIT, ball", overrides=(*_SOFT, *_BALL, 'sensor.name="digit"')),
    TwinScene(name="9DTact, cylinder", overrides=(*_SOFT, 'sensor.name="9dtact"')),
)
