"""``python -m tests.studies NAME``: run one of the studies that validate this program."""

import typer

from tacauchy_rig.app.cli.app import lazy_group, run_program

STUDIES = {
    "fault-table": "tests.studies.fault_table.command:fault_table",
    "force-faults": "tests.studies.force_faults.command:force_faults",
    "tampering": "tests.studies.tampering.command:tamper_table",
    "page": "tests.studies.page.command:page_check",
    "verdict": "tests.studies.verdict.command:verdict_check",
    "budget": "tests.studies.budget.command:budget_check",
    "gel": "tests.studies.gel.command:gel_check",
    "acceptance": "tests.studies.acceptance.command:acceptance",
    "beyond": "tests.studies.beyond.command:beyond_check",
    "press": "tests.studies.press.command:press_check",
    "mounting": "tests.studies.mounting.command:mounting_check",
    "residual": "tests.studies.residual.command:residual_check",
    "twin-bench": "tests.studies.twin_bench.command:twin_bench",
    "libuipc": "tests.studies.libuipc.command:libuipc",
    "power-cuts": "tests.studies.power_cuts.command:power_cuts",
    "sweep-kills": "tests.studies.sweep_kills.command:sweep_kills",
    "hostile-runs": "tests.studies.hostile_runs.command:hostile_runs",
    "judge-page": "tests.studies.judge_page.command:judge_page",
}
"""Where each study's command is."""

app = typer.Typer(
    cls=lazy_group(STUDIES),
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Studies that validate this program itself.",
)


@app.callback()
def options() -> None:
    """Run one study; its page is written to where ``--out`` or ``--page`` says."""


if __name__ == "__main__":
    run_program(app)
