"""A program that presses one scene as its input orders, by the solver on Python's path."""

from __future__ import annotations

import json
import sys

from sim.studies.bench.press import press_scene
from sim.studies.bench.scenes import Manner
from tacauchy_rig.core.errors import RigError


def main() -> None:
    """Read an order from standard input, press, and write what came out as a line of JSON."""
    order = json.load(sys.stdin)
    manner = Manner(**{name: order[name] for name in Manner.__dataclass_fields__})
    try:
        found = press_scene(order["stated"], manner)
    except RigError as error:
        found = {"failure": error.message}
    sys.stdout.write(f"\n{json.dumps(found)}\n")


if __name__ == "__main__":
    main()
