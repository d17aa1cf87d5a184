"""``tacauchy-rig calibrate latency``: delays of force and image, from a press with sway."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from tacauchy_rig.app.cli.options import JsonFile, Overrides
from tacauchy_rig.app.cli.output import complain, say, write_json


def latency(
    path: Annotated[
        Path | None,
        typer.Argument(
            metavar="CONFIG|RUN",
            help="A rig.toml to press with, or a run with sway; the dry run's if absent.",
        ),
    ] = None,
    sway: Annotated[str, typer.Option(help="Duration of the sway.")] = "12s",
    force: Annotated[str, typer.Option(help="Force to press to before the sway.")] = "2N",
    overrides: Overrides = None,
    json_file: JsonFile = None,
) -> None:
    """Press once, sway up and down, and print the delay of force and image against the arm.

    Example: tacauchy-rig calibrate latency rig.toml --json latency.json
    """
    from tacauchy_rig.app.calibration.latency import find_latency
    from tacauchy_rig.app.cli.session import recorded

    swaying = (f'protocol.force_targets=["{force}"]', f'protocol.sway="{sway}"')
    store = recorded(path, [*(overrides or ()), *swaying, 'run.name="latency"'])
    found = find_latency(store)
    for name, each in (("force", found.force), ("image", found.image)):
        say(
            f"{name} is {each.delay_s * 1e3:+.2f} ms behind the arm, standard uncertainty "
            f"{each.uncertainty_s * 1e3:.2f} ms ({each.sample_count} samples, motion explains "
            f"{each.explained:.1%}{_stale(each.stale_count)})"
        )
    worst_s = math.hypot(found.force.uncertainty_s, found.image.uncertainty_s)
    say("for rig.toml:")
    say(f'[force_sensor]\ndelay = "{found.force.delay_s * 1e3:.2f} ms"')
    say(f'[camera]\ndelay = "{found.image.delay_s * 1e3:.2f} ms"')
    say(f'[uncertainty]\ndelay = "{worst_s * 1e3:.2f} ms"')
    write_json(json_file, {"run": str(store.paths.root), "latency": found})
    if found.trigger_missed:
        complain(found.trigger_missed)
        raise typer.Exit(1)


def _stale(count: int) -> str:
    return f"; {count} more show another moment and are left out" if count else ""
