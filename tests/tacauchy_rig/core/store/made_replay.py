"""A replay of a run that nobody simulated."""

import numpy as np

from tacauchy_rig.core.simulated import REPLAY_NAME, Replay, ReplayTrial
from tacauchy_rig.core.store.run_store import ReplayFields, RunStore
from tests.made_model import made_model


def made_trial(index: int, force_n: float) -> ReplayTrial:
    """Return a trial that was replayed to a force."""
    return ReplayTrial(
        index=index,
        force_measured_n=force_n,
        force_simulated_n=force_n,
        depth_simulated_m=3e-4,
        force_error_estimate=0.02,
        force_error_basis="three meshes",
        newton_iterations=12,
        search_iterations=4,
        wall_s={"solve": 1.5},
        balance_relative=1e-9,
        gap_min_m=1e-7,
        min_jacobian=0.8,
        force_history=((1e-4, 0.4), (3e-4, force_n)),
    )


def made_replay(store: RunStore) -> tuple[Replay, dict[int, ReplayFields]]:
    """Return a replay of every trial of a run, and its files, without fields."""
    trials = []
    for index in store.trial_indices():
        record = store.counting(index)
        assert record is not None
        assert record.force_measured_n is not None
        trials.append(made_trial(index, record.force_measured_n))
    model = made_model(young_pa=3e5, residual=None)
    replay = Replay(name=REPLAY_NAME, trials=tuple(trials), model=model, versions={})
    image = np.full((240, 320, 3), 90, np.uint8)
    return replay, {trial.index: ReplayFields(image=image) for trial in trials}
