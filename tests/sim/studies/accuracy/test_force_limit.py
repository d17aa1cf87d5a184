"""The limit of finer meshes, and presses that are kept so that a long measurement can go on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import BoxPad
from sim.scene.scene import Preset, Scene, Target
from sim.studies.accuracy import force_limit
from sim.studies.accuracy.force_limit import PressedPath, PressStore, extrapolated

_SCENE = Scene(
    pad=BoxPad(size_x_m=20e-3, size_y_m=20e-3, height_m=4e-3),
    material=Material(young_pa=0.4e6, poisson=0.45),
    indenter=Sphere(diameter_m=8e-3),
    target=Target(depth_m=0.1e-3),
    preset=Preset.FAST,
    refinement=0.5,
)


def test_a_press_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second time it comes from the folder; another mesh or depth is another press."""
    made = []

    def counted(scene: Scene, depths_m: list[float]) -> PressedPath:
        made.append((scene, depths_m))
        return PressedPath(forces_n=(1.0,), cpu_s=0.5)

    monkeypatch.setattr(force_limit, "pressed_path", counted)
    first = PressStore(folder=tmp_path).pressed_path(_SCENE, [1e-4])
    assert PressStore(folder=tmp_path).pressed_path(_SCENE, [1e-4]) == first
    assert len(made) == 1
    for scene, depth in ((replace(_SCENE, refinement=0.6), 1e-4), (_SCENE, 2e-4)):
        PressStore(folder=tmp_path).pressed_path(scene, [depth])
    assert len(made) == 3


@given(limit=st.floats(0.1, 10.0), constant=st.floats(-0.1, 0.1), order=st.sampled_from([1, 2]))
def test_an_error_of_known_order_is_extrapolated_away(
    limit: float, constant: float, order: int
) -> None:
    """F(h) = limit (1 + c h^p) on h and 1.5 h gives the limit exactly; half the way is doubted."""
    fine, coarse = (limit * (1.0 + constant * h**order) for h in (1.0, 1.5))
    found = extrapolated(fine, coarse, order=order)
    assert found.force_n == pytest.approx(limit, rel=1e-9)
    assert found.error(fine) == pytest.approx(constant, abs=1e-9)
    assert found.doubt == pytest.approx(0.5 * abs(constant), abs=1e-9)
