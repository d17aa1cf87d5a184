"""A replay of made evidence as a simulator's outputs."""

from collections.abc import Mapping

import numpy as np

from reports.evidence.evidence_types import RunEvidence
from reports.scores.force_uncertainty import predict
from tacauchy_rig.core.simulated import Driven, Outputs, PressOutput, Simulator

Arrays = Mapping[int, np.ndarray]


def replay_outputs(
    evidence: RunEvidence,
    heights_m: Arrays | None = None,
    pressures_pa: Arrays | None = None,
    shears_pa: Arrays | None = None,
) -> Outputs:
    """Return images and predicted forces of the evidence, with fields by trial."""
    presses = {
        trial.index: PressOutput(
            image=trial.simulated_image,
            force_n=predict(trial, evidence.contact_force_n)[0],
            height_m=(heights_m or {}).get(trial.index),
            pressure_pa=(pressures_pa or {}).get(trial.index),
            shear_pa=(shears_pa or {}).get(trial.index),
        )
        for trial in evidence.trials
    }
    who = Simulator(name="ours", version="1", driven_by=Driven.DEPTH)
    return Outputs(simulator=who, presses=presses)
