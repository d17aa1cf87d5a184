"""A command that states a scene."""

from __future__ import annotations

from typing import Annotated

import typer
from typer.testing import CliRunner

from sim.scene.material import LawName
from sim.scene.scene import SceneTerms
from tacauchy_rig.app.cli.scene_options import states_a_scene

GIVEN = ("--indenter", "plane", "--law", "linear", "--layer", "a", "--layer", "b", "--twice", "3")


def test_a_command_gets_the_scenes_options_and_its_own() -> None:
    """What was given arrives as the scene's terms, what was not has its default."""
    seen: list[tuple[SceneTerms, int]] = []

    @states_a_scene
    def command(terms: SceneTerms, twice: Annotated[int, typer.Option("--twice")] = 1) -> None:
        """Note what it is called with."""
        seen.append((terms, 2 * twice))

    app = typer.Typer()
    app.command()(command)
    assert CliRunner().invoke(app, list(GIVEN)).exit_code == 0
    terms = SceneTerms(indenter="plane", law=LawName.LINEAR, layer=["a", "b"])
    assert seen == [(terms, 6)]
    assert CliRunner().invoke(app, ["--twice", "3"]).exit_code == 2
