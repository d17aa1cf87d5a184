"""What a begun run may change, and what it is refused by name."""

from __future__ import annotations

import pytest

from tacauchy_rig.core.config.load import OF_DEVICES, Change, load_config, resumed_config
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import ConfigError

WRITTEN = load_config().written


def test_addresses_and_limits_are_changed_and_told() -> None:
    """Old and new value stand beside one another; what stays is no change."""
    config, changes = resumed_config(
        WRITTEN,
        ["camera.device=GelSight Mini", 'limits.stale_image="1 s"', 'limits.soft_force="6 N"'],
    )
    assert config.camera.device == "GelSight Mini"
    assert config.limits.stale_image == 1.0
    assert changes == (
        Change(field="camera.device", old="", new="GelSight Mini"),
        Change(field="limits.stale_image", old="500 ms", new="1 s"),
    )
    assert str(changes[1]) == "limits.stale_image = 1 s, before: 500 ms"


def test_without_a_change_it_is_the_runs_own() -> None:
    """A run that just goes on goes on as it was."""
    assert resumed_config(WRITTEN, []) == (load_config().config, ())


def test_what_the_run_is_cannot_be_changed() -> None:
    """Every such field is refused at once, with what may be changed."""
    given = ['protocol.force_targets=["2 N"]', "sensor.name=digit", "camera.width=320"]
    with pytest.raises(ConfigError) as caught:
        resumed_config(WRITTEN, [*given, 'limits.soft_force="7 N"'])
    fields = [line.split(":")[0] for line in caught.value.message.split("\n")]
    assert fields == ["protocol.force_targets", "sensor.name", "camera.width"]
    assert "force_sensor.port" in caught.value.remedy


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ('limits.hard_force="4000 N"', "above the limit 50 N"),
        ('limits.soft_force="2 N"', "does not clear the highest target"),
        ('limits.soft_forse="7 N"', "did you mean soft_force?"),
    ],
)
def test_a_changed_limit_is_checked_as_any_other(override: str, message: str) -> None:
    """Ceilings, rules and spelling hold for a begun run too."""
    with pytest.raises(ConfigError, match=message.replace("?", r"\?")):
        resumed_config(WRITTEN, [override])


def test_a_run_of_another_time_is_asked_before_it_is_pressed_again() -> None:
    """What was recorded under wider limits is read; pressing needs narrower ones."""
    wide = {**WRITTEN, "limits.max_depth": "100 mm"}
    with pytest.raises(ConfigError, match=r"limits\.max_depth"):
        resumed_config(wide, [])
    config, (change,) = resumed_config(wide, ['limits.max_depth="2 mm"'])
    assert config.limits.max_depth == pytest.approx(2e-3)
    assert change.old == "100 mm"


@pytest.mark.parametrize("field", OF_DEVICES)
def test_each_of_the_devices_fields_is_one(field: str) -> None:
    """A misspelt name could never be given."""
    table, _, name = field.partition(".")
    assert name in RigConfig.model_fields[table].annotation.model_fields
