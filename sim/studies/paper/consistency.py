"""Does the paper agree with itself? Arithmetic on its own numbers, nothing of ours."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim.studies.paper.benchmarks import ENVIRONMENTS
from sim.studies.paper.claims import claims

_LARGEST = 255.0
_MS = 1e3


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One number of the paper, and what its others make of it.

    Attributes:
        says: What is compared.
        stated: The paper's number.
        follows: What follows from its other numbers.
        room: How far rounding alone may part them, as a share.
    """

    says: str
    stated: float
    follows: float
    room: float

    @property
    def agrees(self) -> bool:
        """The two are the same but for rounding."""
        return abs(self.follows - self.stated) <= self.room * abs(self.stated)


def checks() -> tuple[Check, ...]:
    """Return what can be checked."""
    coarse, fine = _stated("mesh.edge_plain"), _stated("mesh.edge")
    # Edges are stated to 0.005 mm either way.
    rounding = 2.0 * (0.005 / coarse + 0.005 / fine)
    return (
        Check(
            says="faces of a closed surface: 2 vertices - 4",
            stated=_stated("mesh.surface_faces"),
            follows=2.0 * _stated("mesh.surface_vertices") - 4.0,
            room=0.0,
        ),
        Check(
            says="growth: refined over not refined tetrahedra",
            stated=_stated("mesh.growth"),
            follows=_stated("mesh.tets") / _stated("mesh.tets_plain"),
            room=0.005,
        ),
        Check(
            says="density: square of the ratio of edges",
            stated=_stated("mesh.density"),
            follows=(coarse / fine) ** 2,
            room=rounding,
        ),
        Check(
            says="frames/s of 60 environments from those of each",
            stated=_stated("speed.sixty"),
            follows=ENVIRONMENTS * _stated("speed.sixty_each"),
            room=0.001,
        ),
        Check(
            says="PSNR at the least MSE [dB]",
            stated=_stated("ends.psnr_db_first"),
            follows=_psnr_db(_stated("ends.mse_least")),
            room=0.001,
        ),
        Check(
            says="physics of a step [ms]: at most a frame of one environment",
            stated=_stated("speed.physics"),
            follows=min(_stated("speed.physics"), _MS / _stated("speed.single")),
            room=0.001,
        ),
        Check(
            says="physics of a step [ms]: at most a frame of 60 environments",
            stated=_stated("speed.physics"),
            follows=min(_stated("speed.physics"), _MS / _stated("speed.sixty_each")),
            room=0.001,
        ),
    )


def _stated(name: str) -> float:
    return claims()[name].value


def _psnr_db(mse: float) -> float:
    return 10.0 * math.log10(_LARGEST**2 / mse)
