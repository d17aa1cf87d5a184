"""What the site's build takes from the program names all of it."""

import tacauchy_rig
from tacauchy_rig.app.cli.app import COMMANDS
from tacauchy_rig.app.replay.simulator_inputs import DEPTH_SHARE, PRESSURE_MODULI
from tacauchy_rig.core.config.load import load_config
from tests.documentation.reference import commands, public_names, rig_toml
from tests.documentation.words import DOCS


def test_every_command_has_a_section() -> None:
    """With its options; none is there twice."""
    sections = [line for line in commands().splitlines() if line.startswith("### ")]
    assert len(sections) == len(set(sections))
    assert {f"### tacauchy-rig {name}" for name in COMMANDS} <= set(sections)
    assert "--press-only" in commands()


def test_every_key_of_rig_toml_has_a_row() -> None:
    """With the unit's dimension, the dry run's value and the reason of its range."""
    page = rig_toml()
    for field in load_config().written:
        assert f"| `{field.split('.')[1]}` |" in page
    assert '| `payload` | mass | `"0.4 kg"` | at least 0 kg; at most 5 kg: a UR5 carries' in page


def test_every_public_name_is_listed() -> None:
    """Under the name that users import."""
    listed = public_names()
    assert all(f"heading: {name}\n" in listed for name in tacauchy_rig.__all__ if name[0] != "_")


def test_limits_of_the_gel_are_those_of_the_page() -> None:
    """They are written by hand there."""
    page = " ".join((DOCS / "reference" / "rig-toml.md").read_text("utf-8").split())
    assert f"at most {100 * DEPTH_SHARE:.0f} % of the gel's height" in page
    assert f"at most {PRESSURE_MODULI:g} times the modulus" in page
