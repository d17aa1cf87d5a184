"""The same forces reached by load and by displacement: the depths have to agree."""

from __future__ import annotations

from sim.replay import replay_forces
from sim.scene.indenter import Cylinder, describe
from sim.scene.scene import Drive, Preset
from sim.sensor.sensor import load_sensor
from tacauchy_rig.tables import Table

_ALLOWED = 1e-3
_TOLERANCE_N = 0.01
# The paper's six forces (section IV-D) [N].
FORCES_N = (1.2556, 1.9511, 2.6466, 3.3422, 4.0377, 4.7332)


def measure(*, preset: Preset = Preset.BALANCED, forces_n: tuple[float, ...] = FORCES_N) -> Table:
    """Replay every force by both drives."""
    sensor = load_sensor("gelsight-mini")
    indenter = Cylinder(diameter_m=5e-3, fillet_m=0.1e-3)
    load, search = (
        replay_forces(
            sensor, indenter, forces_n, preset=preset, tolerance_n=_TOLERANCE_N, drive=drive
        )[0].trials
        for drive in (Drive.LOAD, Drive.SEARCH)
    )
    rows = tuple(
        (
            a.force_measured_n,
            a.depth_simulated_m * 1e3,
            b.depth_simulated_m * 1e3,
            100.0 * (b.depth_simulated_m / a.depth_simulated_m - 1.0),
            b.force_simulated_n - b.force_measured_n,
            a.newton_iterations,
            b.newton_iterations,
        )
        for a, b in zip(load, search, strict=True)
    )
    worst = max(
        abs(b.depth_simulated_m / a.depth_simulated_m - 1.0)
        for a, b in zip(load, search, strict=True)
    )
    return Table(
        title="Replays driven by load and by displacement",
        columns=(
            "F_z [N]",
            "depth by load [mm]",
            "depth by displacement [mm]",
            "difference [%]",
            "force left by displacement [N]",
            "iterations by load",
            "by displacement",
        ),
        rows=rows,
        criterion=f"the depths differ by at most 0.1 %; preset {preset.value}",
        passed=worst <= _ALLOWED,
        note=f"{sensor.title} and {describe(indenter)}, the six forces of the paper. Driven by "
        "displacement (the paper's search) a replay ends within a tenth of its force tolerance, "
        f"here of {_TOLERANCE_N:g} N; driven by load it has none.",
        command=f"tacauchy-rig press --sensor {sensor.name} --indenter {describe(indenter)} "
        f"--force {forces_n[0]:g}N --drive search --preset {preset.value}",
    )
