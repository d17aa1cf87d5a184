"""Requests to the operator: confirmation before the arm moves, and a weight on the cell."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from drivers.emulators.process import hang_weight
from drivers.force_sensor.weighing import Load
from protocols.confirmation import confirmation_screen, expected_answer
from tacauchy_rig.app.cli.output import console, say
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import AbortedError
from tacauchy_rig.core.force_check import Weight


def confirm(config: RigConfig) -> None:
    """Show what will move and ask for the sensor's name."""
    say(confirmation_screen(config))
    console.print("> ", end="")
    answer = sys.stdin.readline().strip()
    if answer != expected_answer(config):
        raise AbortedError(
            f"not confirmed: {answer!r} is not {expected_answer(config)!r}; nothing moved",
            remedy="run the same command again and type the sensor's name",
        )


def ask_for_weight(weight: Weight) -> Callable[[Load], None]:
    """Return what asks a person to hang the weight and to take it off, a line of input each."""
    say(f"check of the cell by {weight} ({weight.force_n:.3f} N); nothing moves meanwhile")
    steps = {
        Load.NONE: "see that nothing hangs on the tool and that it touches nothing",
        Load.WEIGHT: f"hang {weight} on the tool, so that it pulls straight down, and let it rest",
        Load.NONE_AGAIN: "take it off again",
    }

    def ask(load: Load) -> None:
        number = list(steps).index(load) + 1
        say(f"{number} of {len(steps)}: {steps[load]}, then press Enter")
        console.print("> ", end="")
        if not sys.stdin.readline():
            raise AbortedError(
                "the check of the cell was not finished: the input ended; nothing moved",
                remedy="run the same command again, or leave --check-weight out",
            )

    return ask


def hang_emulated(weight: Weight, folder: Path) -> Callable[[Load], None]:
    """Return what hangs the weight on the emulated cell in ``folder`` and takes it off."""

    def hang(load: Load) -> None:
        hangs = load is Load.WEIGHT
        hang_weight(folder, weight.mass_kg if hangs else 0.0)
        say(f"emulated cell: {weight} {'hung on' if hangs else 'not on'} the tool")

    return hang
