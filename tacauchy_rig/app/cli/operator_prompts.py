"""What an operator is asked: to confirm that a real arm moves, and to hang a known weight."""

import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from drivers.emulators.process import hang_weight
from drivers.force_sensor.weighing import Load
from tacauchy_rig.app.cli.output import console, say
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import AbortedError
from tacauchy_rig.core.known_weight import Weight

LAST_WORDS = """\
Any key, Ctrl-C or a lost terminal stops the arm and takes it slowly off the gel;
a second one holds it where it is.
This program is not a safety system. The pendant's emergency stop, safety planes and
reduced mode are. Keep a hand on the stop."""


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


def confirmation_screen(config: RigConfig) -> str:
    """Return what will move, how fast, how hard and where, on one screen."""
    robot = config.robot
    rows = [f"  {name:<10}{text}" for name, text in _rows(config)]
    title = f"A REAL ARM WILL MOVE: UR5 {robot.model.value} at {robot.host}"
    request = f"Type the sensor's name to go: {expected_answer(config)}"
    return "\n".join([title, "", *rows, "", LAST_WORDS, "", request])


def expected_answer(config: RigConfig) -> str:
    """Return what has to be typed: the sensor's name."""
    return Path(config.sensor.name).stem


def _rows(config: RigConfig) -> Iterator[tuple[str, str]]:
    robot, limits, protocol, box = config.robot, config.limits, config.protocol, config.workspace
    count = len(protocol.force_targets)
    air = _millimetres(protocol.air_press_height)
    yield "presses", f"{count} into {config.sensor.name}; before them one in the air, {air} above"
    targets = ", ".join(f"{target:.4f}" for target in protocol.force_targets)
    yield "targets", f"{targets} N, each held for {protocol.dwell_duration:g} s"
    soft, hard = f"{limits.soft_force:g} N", f"{limits.hard_force:g} N"
    yield "forces", f"{soft} stops and retracts, {hard} triggers a protective stop"
    yield "sideways", f"{limits.lateral_force:g} N and {limits.moment:g} N m stop and retract"
    yield "depth", f"{_millimetres(limits.max_depth)} below contact stops and retracts"
    speeds = (robot.approach_speed, robot.search_speed, robot.press_speed, robot.retract_speed)
    names = ("approach", "search", "press", "retract")
    pairs = zip(names, speeds, strict=True)
    yield "speeds", ", ".join(f"{name} {_millimetres(speed)}/s" for name, speed in pairs)
    yield "box", f"x {_range(box.x_min, box.x_max)}, y {_range(box.y_min, box.y_max)}"
    yield "", f"z {_range(box.z_min, box.z_max)}; tilt up to {math.degrees(box.max_tilt):.3g} deg"
    home = ", ".join(f"{value * 1e3:g}" for value in robot.home)
    yield "home", f"({home}) mm; it starts only within {_millimetres(box.home_radius)} of there"


def _range(low: float, high: float) -> str:
    return f"{low * 1e3:g} to {high * 1e3:g} mm"


def _millimetres(length_m: float) -> str:
    return f"{length_m * 1e3:g} mm"


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
