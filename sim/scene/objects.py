"""Five bodies to press into a gel, from sharp edges to smooth curves, made from their formulas."""

from collections.abc import Callable

import numpy as np

from sim.scene.indenter import MeshIndenter, mesh_indenter, ring_walls, turned_triangles
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

_HEIGHT_M = 4e-3
_AROUND = 192


def bar() -> MeshIndenter:
    """Return a bar of 8 x 1.5 mm: four straight sharp edges."""
    return _prism(0.5e-3 * np.array([[8.0, 1.5], [-8.0, 1.5], [-8.0, -1.5], [8.0, -1.5]]), "bar")


def hexagon() -> MeshIndenter:
    """Return a hexagon key of 4 mm across its flats."""
    angle = np.radians(30.0 + 60.0 * np.arange(6))
    radius = 2e-3 / np.cos(np.radians(30.0))
    return _prism(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), "hexagon")


def cross() -> MeshIndenter:
    """Return a cross of 5 mm with arms of 1.5 mm: corners that point in and out."""
    arm, half = 2.5, 0.75
    quarter = np.array([[arm, -half], [arm, half], [half, half]])
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    corners = [quarter @ np.linalg.matrix_power(turn, k) for k in range(4)]
    return _prism(1e-3 * np.concatenate(corners), "cross")


def ring() -> MeshIndenter:
    """Return a torus of 4.4 mm across its middle line and 1.2 mm thick: one smooth curved line."""
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND // 2 + 1)
    line = 2.2e-3 + 0.6e-3 * np.cos(turn), 0.6e-3 * np.sin(turn)
    return mesh_indenter(*turned_triangles(*line, _AROUND), name="object ring")


def ellipsoid() -> MeshIndenter:
    """Return an ellipsoid with half axes of 3, 1.8 and 2 mm: smooth, of no one radius."""
    turn = np.linspace(0.0, np.pi, _AROUND // 2 + 1)
    ball, faces = turned_triangles(np.sin(turn), -np.cos(turn), _AROUND)
    return mesh_indenter(ball * (3e-3, 1.8e-3, 2e-3), faces, name="object ellipsoid")


OBJECTS: dict[str, Callable[[], MeshIndenter]] = {
    each.__name__: each for each in (bar, hexagon, cross, ring, ellipsoid)
}


def parse_object(name: str) -> MeshIndenter:
    """Return a body by its name; raise ConfigError if there is none of this name."""
    if name not in OBJECTS:
        raise ConfigError(
            f"object:{name}: no such object",
            remedy=f"write object: and {', '.join(list(OBJECTS)[:-1])} or {list(OBJECTS)[-1]}",
        )
    return OBJECTS[name]()


def _prism(outline: FloatArray, name: str) -> MeshIndenter:
    """Extrude an outline, shape [n, 2] [m], all of which is seen from the origin."""
    rings = np.zeros((4, len(outline), 3))
    rings[1:3, :, :2], rings[2:, :, 2] = outline, _HEIGHT_M
    walls = ring_walls(np.arange(4 * len(outline), dtype=np.int32).reshape(4, -1))
    return mesh_indenter(rings.reshape(-1, 3), walls, name=f"object {name}")
