"""A time series for ParaView: VTU files, and the PVD that lists them. Times count states."""

import shutil
from pathlib import Path

from sim.fields.saved_press import vtu
from tacauchy_rig.app.replay.press_folder import STATES_NAME
from tacauchy_rig.core.arrays import AnyArray
from tacauchy_rig.core.errors import RecordError, command_line
from tacauchy_rig.core.simulated import REPLAY_NAME
from tacauchy_rig.core.store.run_store import RunStore, unpack_arrays


def states_of(press: Path) -> dict[str, AnyArray]:
    """Return what ``passed_states`` does, and the sensor's name and the gel's density.

    Raises:
        RecordError: The folder holds none.
    """
    found = unpack_arrays(press / STATES_NAME)
    if not found:
        raise RecordError(
            f"{press}: holds no {STATES_NAME}, the states of a press",
            remedy=f"name a folder of `tacauchy-rig press ... --out {press.name}`",
        )
    return found


_PVD = """<?xml version="1.0"?>
<VTKFile type="Collection" version="0.1"><Collection>
{}
</Collection></VTKFile>
"""


def write_vtu(source: Path, out: Path) -> None:
    """Write the gel and the indenter of a press, or the replayed surfaces of a run by trial.

    Raises:
        RecordError: It is neither a press nor a replayed run.
    """
    is_run = (source / "run.json").exists()
    parts = _trials(source, out) if is_run else _states(source, out)
    lines = (f'<DataSet timestep="{k}" part="{part}" file="{name}"/>' for k, part, name in parts)
    (out / "series.pvd").write_text(_PVD.format("\n".join(lines)))


def _states(press: Path, out: Path) -> list[tuple[int, int, str]]:
    """Write each state of a press; return time, part and name of each file."""
    found, written = states_of(press), []
    triangles, vertices = found["indenter_faces"], found["indenter_vertex_m"]
    for k, nodes in enumerate(found["node_m"]):
        on_nodes = {n: found[n][k] for n in ("contact_pressure_pa", "contact_shear_pa")}
        on_nodes["displacement_m"] = nodes - found["node_rest_m"]
        placed = vertices @ found["indenter_rotation"][k].T + found["indenter_tip_m"][k]
        for part, name, content in (
            (0, f"gel-{k:03d}.vtu", vtu(found["elements"], nodes, on_nodes, {})),
            (1, f"indenter-{k:03d}.vtu", vtu(triangles, placed, {}, {})),
        ):
            (out / name).write_bytes(content)
            written.append((k, part, name))
    return written


def _trials(run: Path, out: Path) -> list[tuple[int, int, str]]:
    """Copy the surface of each replayed trial; return time, part and name of each file."""
    store, written = RunStore.open(run), []
    for trial in store.trial_indices():
        path = store.paths.replay_trial(REPLAY_NAME, trial) / "surface.vtu"
        if path.exists():
            shutil.copy2(path, out / f"surface-{trial:02d}.vtu")
            written.append((trial, 0, f"surface-{trial:02d}.vtu"))
    if not written:
        raise RecordError(
            f"{run}: holds no replayed trial", remedy=f"`{command_line('replay', run)}` first"
        )
    return written
