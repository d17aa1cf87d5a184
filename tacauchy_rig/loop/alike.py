"""Are an imported run's presses such as one replay can press: one indenter, one place?"""

from __future__ import annotations

import numpy as np

from tacauchy_rig.errors import ConfigError
from tacauchy_rig.imported import SAME_PLACE_M
from tacauchy_rig.store.run_store import RunStore


def check_alike(store: RunStore) -> None:
    """Refuse presses that a replay would press with another's indenter, or elsewhere.

    A replay presses one indenter at one place; what differs is not passed over in silence.

    Raises:
        ConfigError: Presses had several indenters or places.
        RecordError: The run was imported, and the file that says so is missing or damaged.
    """
    trials = store.imported_trials
    if not trials:
        return
    where = store.paths.root
    terms = sorted({each.indenter or "the run's" for each in trials.values()})
    if len(terms) > 1:
        raise ConfigError(
            f"{where}: its presses had {len(terms)} indenters ({', '.join(terms)[:200]})",
            remedy="a replay presses one: import the presses of each as a run of its own",
        )
    places = np.array([each.place_m for each in trials.values() if each.place_m is not None])
    apart_m = float(np.ptp(places, axis=0).max()) if len(places) else 0.0
    if apart_m > SAME_PLACE_M or 0 < len(places) < len(trials):
        raise ConfigError(
            f"{where}: {len(places)} of its {len(trials)} presses have a known place, and those "
            f"lie up to {apart_m * 1e3:.3f} mm apart",
            remedy=f"a replay presses at one place, to {SAME_PLACE_M * 1e3:g} mm: import the "
            "presses of each as a run of its own",
        )
