"""Pressure and shear where a camera's pixels look, from the nodes of a model."""

from __future__ import annotations

import numpy as np
import scipy.sparse
from scipy.spatial import Delaunay

from sim.fields.contact_traction import surface_traction
from sim.fields.press_fields import top_surface
from sim.sensor.camera_geometry import CameraGeometry
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import FloatArray


class SurfaceMaps:
    """Tractions of a model's contact surface as maps.

    What is laid out once: which nodes a pixel is between, and by which shares. It is so on the
    undeformed surface: a map says what acts on the gel that lies at rest where a pixel looks.

    Args:
        model: A part of a pad is drawn whole.
        geometry: Where the pixels of a map look.
    """

    def __init__(self, model: Model, geometry: CameraGeometry) -> None:
        self._model, self._shape = model, (geometry.height, geometry.width)
        top = top_surface(model)
        self._sources = top.sources
        x, y = geometry.pad_grid()
        places = np.column_stack([x.ravel(), y.ravel()])
        mesh = Delaunay(top.rest[:, :2])
        found = mesh.find_simplex(places)
        inside = np.flatnonzero(found >= 0)
        simplex = found[inside]
        to_shares = mesh.transform[simplex]
        first = np.einsum("nij,nj->ni", to_shares[:, :2], places[inside] - to_shares[:, 2])
        shares = np.column_stack([first, 1.0 - first.sum(axis=1)])
        self._shares = scipy.sparse.csr_matrix(
            (shares.ravel(), (np.repeat(inside, 3), mesh.simplices[simplex].ravel())),
            shape=(len(places), len(top.rest)),
        )

    def of(self, point: PathPoint) -> tuple[FloatArray, FloatArray]:
        """Return pressure and size of shear [Pa], each of shape [height, width]."""
        found = surface_traction(self._model, point)
        sizes = np.linalg.norm(found.tangential_pa, axis=1)
        return self._drawn(found.pressure_pa), self._drawn(sizes)

    @property
    def none(self) -> FloatArray:
        """The map of an untouched gel [Pa]."""
        return np.zeros(self._shape)

    def _drawn(self, values: FloatArray) -> FloatArray:
        return np.asarray((self._shares @ values[self._sources]).reshape(self._shape))
