"""What a replay asks of a configuration alone: it can be told while the run is recorded."""

from __future__ import annotations

from dataclasses import dataclass

from sim.effects.plan import plan_effects
from sim.leaning import can_lean
from sim.walk import goes_its_own_way
from tacauchy_rig.app.replay.inputs import ReplayInputs, inputs_of
from tacauchy_rig.app.replay.mounting import Restoring, restoring_of, tried_forces
from tacauchy_rig.core.config.model import PoseSource, RigConfig
from tacauchy_rig.core.errors import RigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Foreseen:
    """What is known before any force is measured.

    Attributes:
        config: It.
        settled: Its replay, with the preset that ``auto`` is for the forces that are to be pressed.
        restoring: How the gel answers a lean; None where nothing asks for one, or where times that
            are not measured yet change it.
    """

    config: RigConfig
    settled: ReplayInputs
    restoring: Restoring | None = None

    def settles(self, config: RigConfig) -> bool:
        """Return whether ``settled`` is what another configuration is replayed with, too."""
        return all(
            getattr(self.config, table) == getattr(config, table)
            for table in ("sensor", "replay", "protocol")
        )


def foresee(config: RigConfig) -> Foreseen:
    """Return what is known before any force is measured.

    Raises:
        ConfigError: A configured name does not exist.
    """
    settled = inputs_of(config).settled(config.protocol.force_targets)
    if config.replay.pose is not PoseSource.FOUND or not can_lean(settled.indenter):
        return Foreseen(config=config, settled=settled)
    forces_n = tried_forces(config)
    try:
        waits = goes_its_own_way(plan_effects(settled.scene(forces_n)))
        restoring = None if waits else restoring_of(settled, forces_n)
    except RigError:
        restoring = None  # tried again with what was measured, it says why
    return Foreseen(config=config, settled=settled, restoring=restoring)
