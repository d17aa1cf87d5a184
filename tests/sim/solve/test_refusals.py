"""Presses that no indenter can make: passed through, at the base, beyond what the gel carries."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sim.effects.effect_plan import full_plan
from sim.effects.scene_path import path_for
from sim.press import press
from sim.press_command import scene_from
from sim.scene.indenter import Cylinder, Sphere, tilted
from sim.solve.loading_path import LoadingPath
from sim.solve.starts import base_depth_m, faces_gel
from tacauchy_rig.core.errors import ConfigError, TimeLimitError
from tests.sim.test_press import small_model

BALL = "--pad box:10x10x4mm --young 0.2MPa --poisson 0.48 --preset fast --indenter sphere:diameter="


def test_a_contact_faces_the_gel_where_it_presses_from_outside() -> None:
    """By hand: forces along the outward normal press; friction may lean them, a pull may not."""
    outward = np.array([[[0.0, 0.0, 2.0], [0.0, 0.0, 3.0]]])
    pressing = np.array([[[0.0, 0.0, 1.0], [0.4, 0.0, 1.0]]])
    assert faces_gel(pressing, outward, friction=0.0)
    assert not faces_gel(-pressing, outward, friction=0.0)
    leaning = np.array([[[1.0, 0.0, 1.0], [1.0, 0.0, 1.0]]]) * [1.5, 1.0, 1.0]
    assert not faces_gel(leaning, outward, friction=0.0)
    assert faces_gel(leaning, outward, friction=1.5)


def test_a_small_ball_stays_outside_of_a_coarse_gel() -> None:
    """Deeper there is more force; it passed through the surface, and felt -0.0135 N there."""
    scene = replace(scene_from(f"{BALL}1mm --depth 1.0mm"), refinement=0.6)
    path = path_for(scene, full_plan(scene))
    above, below = (float(path.advance(depth).force_n[2]) for depth in (0.9e-3, 1.0e-3))
    assert below > above > 0.0


def test_a_depth_beyond_the_base_is_refused_before_anything_is_solved() -> None:
    """A tilted punch's rim reaches it before its middle."""
    path = LoadingPath(small_model(), Sphere(diameter_m=4e-3))
    with pytest.raises(ConfigError, match="at its base"):
        path.advance(4.1e-3)
    assert path.last is None
    reach = np.array([[-9e-3, -9e-3], [9e-3, 9e-3]])
    punch, tilt = Cylinder(diameter_m=5e-3), math.radians(10.0)
    depth = base_depth_m(punch, tilted(tilt, 0.0), reach_m=reach, touch_m=4e-3)
    assert depth == pytest.approx(4e-3 - 2.5e-3 * math.sin(tilt), abs=0.03e-3)


def test_a_force_far_beyond_the_gel_is_refused_before_meshing() -> None:
    """The remedy is less force; the estimate is named."""
    with pytest.raises(ConfigError, match="more than the gel can carry") as caught:
        press(scene_from(f"{BALL}4mm --force 1000N"))
    assert "less force" in caught.value.remedy


def test_a_press_ends_at_its_time_limit() -> None:
    """Wherever it is; the message says so."""
    with pytest.raises(TimeLimitError, match="time limit of 1e-06 s"):
        press(scene_from(f"{BALL}4mm --force 1N"), time_limit_s=1e-6)
