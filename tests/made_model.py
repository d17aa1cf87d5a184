"""A replay's model that was made up."""

from typing import Any

from tacauchy_rig.core.simulated import (
    Alternative,
    FoundCause,
    ReplayModel,
    ResidualSplit,
    TrialSplit,
)


def made_split() -> ResidualSplit:
    """Return the split of six presses, one cause of which takes back what another does."""
    shares = {
        "rest": 0.5,
        "pose": 0.3,
        "tilt": 0.15,
        "noise": 0.05,
        "light": 0.03,
        "force error": 0.02,
        "material": 0.01,
        "optics": -0.06,
    }
    return ResidualSplit(
        trials=tuple(TrialSplit(trial=k, residual=0.2, shares=shares) for k in range(1, 7)),
        shares=shares,
        found=(FoundCause(name="lean towards x", cause="tilt", value=0.01, unit="rad"),),
    )


def made_model(**changes: Any) -> ReplayModel:
    """Return a model of preset balanced between a cheaper and a better one."""
    facts: dict[str, Any] = {
        "sensor": "gelsight-mini",
        "indenter": "cylinder of 5 mm",
        "centre_x_m": 0.0,
        "centre_y_m": 0.0,
        "contact": "frictionless",
        "drive": "load",
        "law": "stable-neo-hookean",
        "young_pa": 435e3,
        "poisson": 0.48,
        "layers": (),
        "preset": "balanced",
        "element": "P2",
        "element_is_linear": False,
        "tet_count": 1200,
        "node_count": 2100,
        "mesh": "revolved",
        "mesh_hash": "0f",
        "barrier_m": 1e-5,
        "linear_solver": "scipy",
        "device": "cpu",
        "setup_s": 0.5,
        "tolerance": "2% of F_z",
        "force_error_largest_relative": 0.0123,
        "wall_s": 20.0,
        "alternatives": (
            Alternative(
                role="cheaper", setting="fast", error_relative=0.0321, time_ratio=0.25, wall_s=5.0
            ),
            Alternative(
                role="better", setting="accurate", error_relative=None, time_ratio=2.5, wall_s=50.0
            ),
        ),
        "effects": (),
        "residual": made_split(),
    }
    return ReplayModel(**{**facts, **changes})
