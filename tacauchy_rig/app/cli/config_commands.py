"""``tacauchy-rig config``: show values with their origin, and write an example."""

from pathlib import Path

import typer
from rich.table import Table

from tacauchy_rig.app.cli.output import ConfigFile, Found, Overrides, console, say
from tacauchy_rig.core import tables
from tacauchy_rig.core.store.atomic_write import writing


def show(path: ConfigFile = None, overrides: Overrides = None) -> Found:
    """List every field with its value and origin; refuse settings that cannot be replayed.

    Example: tacauchy-rig config show rig.toml
    """
    from tacauchy_rig.app.replay.simulator_inputs import check_gel, check_replay
    from tacauchy_rig.core.config.load import load_config

    loaded = load_config(path, overrides=overrides or ())
    table = Table("field", "value", "from", box=None)
    for field, value in loaded.written.items():
        table.add_row(field, str(value), loaded.sources[field])
    console.print(table)
    check_gel(loaded.config)
    check_replay(loaded.config)
    say(f"configuration hash {loaded.config_hash[:16]}")
    fields = [
        {"field": field, "value": value, "source": loaded.sources[field]}
        for field, value in loaded.written.items()
    ]
    return Found({"config_hash": loaded.config_hash, "fields": fields})


def example(out: Path | None = None) -> Found:
    """Write the commented example for a real rig.

    Example: tacauchy-rig config example rig.toml

    Args:
        out: File to write; standard output if absent.
    """
    from tacauchy_rig.core.config.load import example_text

    if out is None:
        say(example_text())
    else:
        with writing(out), out.open("x", encoding="utf-8") as file:
            file.write(example_text())
        say(f"wrote {out}; fill in the values of your devices, then: tacauchy-rig doctor {out}")
    return Found({"file": out, "text": example_text()})


def show_ceilings() -> Found:
    """Print the limits of each value on any rig, and why.

    Example: tacauchy-rig config ceilings
    """
    from tacauchy_rig.app.replay.simulator_inputs import DEPTH_SHARE, PRESSURE_MODULI
    from tacauchy_rig.core.config.field_ranges import ceilings
    from tacauchy_rig.core.markdown_page import page

    table = tables.table_of(
        ceilings(),
        {
            "field": lambda entry: f"`{entry[0]}`",
            "at least": lambda entry: entry[1].least,
            "at most": lambda entry: entry[1].most,
            "because": lambda entry: entry[1].because,
        },
    )
    facts = {"ceilings": table, "depth_share": DEPTH_SHARE, "moduli": PRESSURE_MODULI}
    typer.echo(page("tacauchy_rig.app.cli", "ceilings.md.jinja", facts), nl=False)
    return Found({"ceilings": dict(ceilings())})
