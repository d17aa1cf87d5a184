"""What ``press`` says besides numbers."""

from __future__ import annotations

from typer.testing import CliRunner

from tacauchy_rig.cli.app import app

DISC = ("--pad", "disc:radius=6mm,height=2mm", "--young", "0.43MPa", "--poisson", "0.45")
PRESS = ("--indenter", "sphere:diameter=4mm", "--depth", "0.05mm", "--preset", "fast")


def test_printed_law_warns_of_its_stress_at_rest() -> None:
    """The paper's Eq. 4 is run, with the tension and the shrinkage it brings named."""
    done = CliRunner().invoke(app, ["press", *DISC, *PRESS, "--law", "paper-eq4"])
    assert done.exit_code == 0
    assert "tension of 148.3 kPa at rest" in done.stderr
    assert "shrink by 4.0% per axis" in done.stderr
    assert "force" in done.stdout
