"""Measurements for the paper's page, made up."""

from sim.studies.paper.kept_results import SCORES, Report, SceneSpeed, Speeds
from sim.studies.paper.presses import AS_CONFIGURED, BALANCED, FAST, FORCES_N, THIN, ModelPresses

FLOOR = {"ssim": 0.97, "ncc": 0.9, "histogram_correlation": 0.9, "psnr_db": 30.0, "mse": 60.0}


def model(name: str, *, force_n: float = 3.0, sigma_off: float = 0.01) -> ModelPresses:
    """Return a model that goes 0.1 mm deep for a newton."""
    at_depth = {
        "force_n": force_n,
        "off_n": 0.0,
        "depth_m": 0.5e-3,
        "gap_m": 1e-6,
        "radius_m": 2.5e-3,
        "sigma_off": sigma_off,
        "newton_iterations": 10,
    }
    return {"name": name, "at_depth": at_depth, "at_forces": [at_depth] * len(FORCES_N)}


def presses(*, paper_force_n: float = 6.0) -> dict[str, ModelPresses]:
    """Return the paper's model, its mesh and two of ours; the reference has 3 N."""
    return {
        AS_CONFIGURED: model(AS_CONFIGURED, force_n=paper_force_n, sigma_off=0.1),
        THIN: model(THIN, force_n=7.0, sigma_off=0.36),
        FAST: model(FAST),
        BALANCED: model(BALANCED),
    }


def speeds() -> Speeds:
    """Return one scene alone and in 60 environments, ten times the paper's."""
    return Speeds(
        gpu=tuple(
            SceneSpeed(
                scene="ball", environments=count, frames_per_s=fps, stress_s=1e-5, file="h.json"
            )
            for count, fps in ((1, 334.0), (60, 5550.0))
        ),
        cpu_frames_per_s=44.0,
        cpu_machine="a machine",
    )


def report(*, emulated: bool, ours: bool) -> Report:
    """Return a report of one press, on real or emulated devices, with images of ours or not."""
    scores = dict.fromkeys(SCORES, 0.5)
    return {
        "name": "a sensor",
        "emulated": emulated,
        "imported": not emulated,
        "made": "today",
        "press_count": 6,
        "no_contact": FLOOR,
        "ours": scores if ours else {},
        "trials": [{"force_n": 1.0, **scores}] if ours else [],
    }
