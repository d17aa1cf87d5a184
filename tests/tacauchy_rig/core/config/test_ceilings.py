"""Values that no rig can honour, and defaults that say where they are from."""

import pytest

from tacauchy_rig.core.config.field_ranges import ceilings
from tacauchy_rig.core.config.load import check_config, load_config, restore_config
from tacauchy_rig.core.config.settings import UncertaintySection, stated_uncertainty
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import parse_quantity

BOUNDLESS = {
    "force_sensor.capacity": "5000 N",
    "workspace.max_tilt": "360 deg",
    "limits.soft_force": "3000 N",
    "limits.hard_force": "4000 N",
    "limits.max_depth": "100 mm",
    "protocol.force_targets": ["2500 N"],
    "report.max_contact_residual": 5,
}
"""A file whose every number is a number, and which never stops an arm."""


def test_a_file_without_limits_is_refused_field_by_field() -> None:
    """Each field is named in one message, with what is allowed and why."""
    with pytest.raises(ConfigError) as caught:
        load_config(overrides=[f"{field}={value}" for field, value in BOUNDLESS.items()])
    lines = caught.value.message.split("\n")
    assert [line.split(":")[0].removesuffix("[0]") for line in lines] == list(BOUNDLESS)
    assert lines[4] == (
        'limits.max_depth: "100 mm" is above the limit 10 mm; write at most "10 mm" '
        "(no known gel is as thick)"
    )
    assert lines[6].startswith("report.max_contact_residual: 5 is above the limit 0.7; write at")


def test_what_was_pressed_is_read_and_not_pressed_again() -> None:
    """A recorded run may have allowed more; whoever presses again is asked again."""
    assert restore_config(BOUNDLESS).limits.max_depth == pytest.approx(0.1)
    nested: dict[str, dict[str, object]] = {}
    for field, value in {**load_config().written, **BOUNDLESS}.items():
        table, _, name = field.partition(".")
        nested.setdefault(table, {})[name] = value
    with pytest.raises(ConfigError, match=r"limits\.max_depth"):
        check_config(nested, defaulted=frozenset())


@pytest.mark.parametrize("field", [field for field, _ in ceilings()])
def test_each_ceiling_is_one_of_a_field_and_refuses(field: str) -> None:
    """A bound just crossed is named; a misspelt one would never be asked."""
    ceiling = dict(ceilings())[field]
    for bound in (ceiling.most, ceiling.least):
        if bound is None:
            continue
        value = parse_quantity(bound, dimension=ceiling.dimension)
        number = bound.split(" ")[0]
        beyond = float(number) * 1.01 if value else -0.01
        is_count = field in ("protocol.attempts", "limits.repeat_count")
        text = str(int(number) + 1) if is_count else bound.replace(number, f"{beyond:g}")
        written = f'["{text}"]' if field == "protocol.force_targets" else text
        if field in ("replay.tilt", "replay.offset", "emulation.tilt"):
            written = f'["{text}", "{text}"]'
        with pytest.raises(ConfigError) as caught:
            load_config(overrides=[f"{field}={written}"])
        told = [line for line in caught.value.message.split("\n") if line.startswith(field)]
        assert told
        assert told[0].endswith(f"({ceiling.because})")


def test_a_message_stays_readable() -> None:
    """Neither a value as long as a file nor a hundred wrong ones make a message of kilobytes."""
    with pytest.raises(ConfigError) as caught:
        load_config(overrides=[f"camera.rate={'9' * 30_000} parsecs"])
    assert len(caught.value.message) < 1000
    targets = ", ".join(['"1 m"'] * 90)
    with pytest.raises(ConfigError) as caught:
        load_config(overrides=[f"protocol.force_targets=[{targets}]"])
    lines = caught.value.message.split("\n")
    assert len(lines) == 41
    assert lines[-1].startswith("... and 5")


@pytest.mark.parametrize("field", UncertaintySection.model_fields)
def test_every_field_has_a_default_with_its_source(field: str) -> None:
    """None is zero, and none is silent."""
    found = stated_uncertainty(load_config().config, field)
    assert found.value > 0.0
    assert found.source.startswith("default: ")


def test_rig_toml_overrules_and_unstated_fields_change_no_hash() -> None:
    """Runs that were recorded before there was such a table keep theirs."""
    plain = load_config()
    assert "uncertainty" not in plain.config.model_dump(mode="json")
    config = load_config(overrides=['uncertainty.fillet="10 um"']).config
    found = stated_uncertainty(config, "fillet")
    assert found.value == pytest.approx(1e-5)
    assert "rig.toml" in found.source


def test_a_tilt_that_no_workspace_allows_is_refused() -> None:
    """So uncertain that the verdict would say nothing."""
    with pytest.raises(ConfigError, match=r"uncertainty\.tilt"):
        load_config(overrides=['uncertainty.tilt="20 deg"'])
