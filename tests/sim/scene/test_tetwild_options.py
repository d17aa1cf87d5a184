"""Settings of fTetWild as text."""

from __future__ import annotations

import pytest

from sim.scene.scene import parse_tetwild_options
from tacauchy_rig.core.errors import ConfigError


def test_mesh_settings_are_read() -> None:
    """Those that are given; the others stay the preset's."""
    tetwild = parse_tetwild_options("l_r=0.08,dihedral_min=5deg")
    assert tetwild.l_r == pytest.approx(0.08)
    assert tetwild.dihedral_min_rad == pytest.approx(0.0872664626)
    assert tetwild.stop_energy is None
    with pytest.raises(ConfigError, match="unknown mesh setting edge"):
        parse_tetwild_options("edge=1mm")
    with pytest.raises(ConfigError, match="l_r = 3"):
        parse_tetwild_options("l_r=3")
