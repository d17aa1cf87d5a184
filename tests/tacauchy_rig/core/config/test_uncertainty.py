"""A default says where it is from; what rig.toml says takes its place."""

from __future__ import annotations

import pytest

from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.model import UncertaintySection
from tacauchy_rig.core.config.uncertainty import stated_uncertainty
from tacauchy_rig.core.errors import ConfigError


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
