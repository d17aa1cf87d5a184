"""Case 13: every kernel computed in float32.

The simulator is written in float64. A copy of its source in which the Warp code says float32 is
run as a program of its own: positions, deformation gradients, stresses, gaps, forces and Hessian
blocks are then computed and summed in single precision. Newton's vectors, its energy sums and the
linear solver stay in double precision, as in any mixed-precision solver.

The gap is a difference of coordinates and carries their rounding, some tenths of a nanometre. The
barrier distance is therefore part of the case: judged is 10 um; that of a scene, 1 um, is reported.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import sim
import tacauchy_rig
from sim.device import KERNEL_EPSILON
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Indenter, describe
from sim.solve.loading_path import LoadingPath
from sim.studies.hard_cases.small_pads import BALL, PUNCH, Measured, pad_model, round_mesh

_SCALAR = re.compile(r"\bwp\.float64\b")
_NATIVE = re.compile(r"\bdouble\b(?=\*? )")
_COMPOSED = re.compile(r"\bwp\.(vec[234]|mat22|mat33|mat44)d\b")
BARRIERS_M = (1e-5, 1e-6)
_PRESS_DEPTH_M = 0.3e-3


def single_precision() -> Measured:
    """Press in both precisions and compare."""
    double, single = presses(), _single_presses()
    measured: Measured = {
        "kernel_rounding_float64": double[0]["kernel_epsilon"],
        "kernel_rounding_float32": single[0]["kernel_epsilon"],
    }
    worst = dict.fromkeys(BARRIERS_M, 0.0)
    for exact, rounded in zip(double, single, strict=True):
        deviation = rounded["force_n"] / exact["force_n"] - 1.0
        barrier = exact["barrier_m"]
        worst[barrier] = max(worst[barrier], abs(deviation))
        off = rounded["residual_n"] / rounded["force_n"]
        measured[f"{exact['name']}, barrier {barrier * 1e6:g} um"] = (
            f"force {deviation:+.1e}, residual {off:.1e} of it, "
            f"{rounded['iterations']} iterations instead of {exact['iterations']}"
        )
    for barrier, deviation in worst.items():
        measured[f"force_deviation_max_at_{barrier * 1e6:g}_um"] = deviation
    flagged, mistaken = (sum(press["stalled"] for press in found) for found in (single, double))
    stalls = {"float32_stalls_flagged": flagged, "float64_stalls_flagged": mistaken}
    return measured | {"presses": len(single), **stalls}


def in_single_precision(source: str) -> str:
    """Return Warp source with every real type of half the length."""
    halved = _NATIVE.sub("float", _SCALAR.sub("wp.float32", source))
    return _COMPOSED.sub(r"wp.\1f", halved)


def _single_presses() -> list[dict[str, Any]]:
    origin = Path(sim.__path__[0])
    with TemporaryDirectory() as folder:
        for path in origin.rglob("*"):
            copy = Path(folder) / origin.name / path.relative_to(origin)
            if path.suffix not in (".py", ".cu", ".toml", ".json") or not path.is_file():
                continue
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_text(in_single_precision(path.read_text(encoding="utf-8")), encoding="utf-8")
        spine = str(Path(tacauchy_rig.__path__[0]).parent)
        known = [path for path in (folder, spine, os.environ.get("PYTHONPATH", "")) if path]
        done = subprocess.run(
            [sys.executable, "-m", "sim.studies.hard_cases.precision"],
            check=True,
            capture_output=True,
            text=True,
            cwd=folder,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(known)},
        )
    found: list[dict[str, Any]] = json.loads(done.stdout)
    return found


def presses() -> list[dict[str, Any]]:
    """Press a punch and a ball into linear and quadratic elements.

    Returns:
        Of each press d_hat as ``barrier_m``, F_z as ``force_n``, the norm of what is unbalanced as
        ``residual_n``, whether Newton said that rounding ended it as ``stalled``, and the kernels'
        relative rounding as ``kernel_epsilon``.
    """
    return [
        _press(order, indenter, barrier_m)
        for barrier_m in BARRIERS_M
        for order in ElementOrder
        for indenter in (PUNCH, BALL)
    ]


def _press(order: ElementOrder, indenter: Indenter, barrier_m: float) -> dict[str, Any]:
    path = LoadingPath(pad_model(round_mesh(), order=order, distance_m=barrier_m), indenter)
    point = path.advance(_PRESS_DEPTH_M)
    return {
        "name": f"{order.value} {describe(indenter)}",
        "barrier_m": barrier_m,
        "force_n": float(point.force_n[2]),
        "residual_n": point.equilibrium.residual_n,
        "stalled": point.equilibrium.stalled,
        "iterations": path.counts.newton_iterations,
        "kernel_epsilon": KERNEL_EPSILON,
    }


if __name__ == "__main__":
    sys.stdout.write(json.dumps(presses()))
