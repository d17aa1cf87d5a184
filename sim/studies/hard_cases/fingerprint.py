"""One press in a few digits, to compare runs; as a program it prints them."""

from __future__ import annotations

import hashlib
import sys
from dataclasses import dataclass

from sim.solve.load_steps.path import LoadingPath
from sim.studies.hard_cases.pads import DOMED, PUNCH, pad_model, round_mesh


@dataclass(frozen=True, slots=True, kw_only=True)
class Fingerprint:
    """F_z [N] and the hash of all nodal positions: equal for bitwise equal results."""

    force_n: float
    positions_hash: str


def fingerprint() -> Fingerprint:
    """Press a filleted cylinder into a domed pad."""
    path = LoadingPath(pad_model(round_mesh(pad=DOMED)), PUNCH)
    point = path.advance(0.2e-3)
    digest = hashlib.sha256(point.state.positions.tobytes()).hexdigest()
    return Fingerprint(force_n=float(point.force_n[2]), positions_hash=digest)


if __name__ == "__main__":
    found = fingerprint()
    sys.stdout.write(f"{found.force_n.hex()} {found.positions_hash}\n")
