"""One press whose fields are looked at."""

import pytest

from sim.effects.presets import build_model
from sim.press_arguments import scene_from
from sim.scene.scene import Scene
from sim.solve.loading_path import LoadingPath
from sim.solve.path_point import PathPoint


@pytest.fixture(scope="session")
def ball() -> Scene:
    """A ball in a disc."""
    return scene_from(
        "--pad disc:radius=8mm,height=4mm --young 0.3MPa --poisson 0.47 "
        "--indenter sphere:diameter=8mm --depth 0.2mm --preset fast"
    )


@pytest.fixture(scope="session")
def pressed(ball: Scene) -> tuple[LoadingPath, PathPoint]:
    """Its path in a quarter of the disc, and the end of it."""
    path = LoadingPath(build_model(ball), ball.indenter)
    return path, path.advance(0.2e-3)
