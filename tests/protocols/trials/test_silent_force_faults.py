"""A force sensor that lies in a whole trial, and true ones that must not be called liars.

The gel is a GelSight Mini under a 5 mm punch, as the simulator has it with preset fast.
"""

import random
from dataclasses import replace

import pytest

from drivers.emulators.faults import parse_fault
from protocols.guard.place_and_motion import BEYOND_M
from tacauchy_rig.core.run import Outcome
from tests.protocols.conftest import NEAR, fresh_plan
from tests.studies.force_faults.worlds import EXPECTED, MiniGel

TARGETS_N = (1.2556, 1.9511, 2.6466, 3.3422, 4.0377, 4.7332)
SHORT = (*NEAR, 'protocol.tare_duration="0.4 s"', "protocol.attempts=1")
SILENT = (
    "scale=0.1", "scale=0.5", "stick", "stick-noisily", "sign", "swap-axes", "old-data", "scale=3"
)  # fmt: skip
MOMENTS = (("start", 0.0), ("search", 0.1), ("press", 0.1), ("press", 0.8))
CAUSES = {
    "scale=0.1": ("range, unit",),
    "scale=0.4": ("range, unit",),
    "scale=0.5": ("range, unit",),
    "scale=0.6": ("range, unit",),
    "scale=3": ("range, unit",),
    "stick": ("sticks",),
    "stick-noisily": ("sticks",),
    "sign": ("compression_sign", "sign or axes"),
    "swap-axes": ("axes",),
    "old-data": ("lags", "old data", "identical"),
}


def of_mini(laboratory, *settings, targets_n, stiffness=1.0, sees=True, **world):
    """Return a laboratory with a Mini's gel; a cell with a bias would show most lies at once."""
    targets = ", ".join(f'"{target_n} N"' for target_n in targets_n)
    lab = laboratory(
        f"protocol.force_targets=[{targets}]",
        *settings,
        gel=MiniGel(stiffness=stiffness),
        bias=(0.0,) * 6,
        surface_offset_m=0.9e-3,
        ways=SHORT,
        **world,
    )
    if not sees:  # the camera is no witness
        lab.cycle.rig.camera.ask = lambda _look: None
    return lab


def watch_peak(lab):
    """Return a list whose last value is the largest true force from now on [N]."""
    peaks_n = [0.0]
    lab.world.on_step(lambda _: peaks_n.append(max(peaks_n[-1], lab.world.force_n)))
    return peaks_n


def pressed(
    laboratory, silent, moment, target_n, *, model="e-series", expected=EXPECTED, sees=True
):
    """Press once into a stiff gel with a cell that lies from a moment on.

    Returns:
        The result and the true peak [N].
    """
    settings = [f'robot.model="{model}"']
    lab = of_mini(
        laboratory, *settings, targets_n=[target_n], stiffness=1.2, sees=sees, expected=expected
    )
    peaks_n = watch_peak(lab)
    fault = parse_fault(f"force_sensor:{silent}")
    phase, delay_s = moment
    if phase == "start":
        lab.world.begin(fault)
    else:
        lab.when_phase(phase, lambda: lab.world.begin(fault), delay_s=delay_s)
    return lab.run(), peaks_n[-1]


def assert_found(result, peak_n, silent, target_n):
    """It did not pass, the gel was spared, and the message offers the cause."""
    assert result.outcome is Outcome.FAULT
    assert peak_n <= 1.5 * target_n + 0.5, result.reason
    told = f"{result.reason} {result.remedy}"
    assert any(cause in told for cause in CAUSES[silent]), told


@pytest.mark.parametrize("silent", SILENT)
def test_a_silent_fault_is_found_before_the_gel_suffers(laboratory, silent):
    """The lightest target leaves the least room; a stiff gel the least time."""
    for moment in (MOMENTS[0], MOMENTS[2]):
        result, peak_n = pressed(laboratory, silent, moment, TARGETS_N[0])
        assert_found(result, peak_n, silent, TARGETS_N[0])


@pytest.mark.parametrize("silent", ["scale=0.1", "scale=0.5", "stick-noisily"])
def test_the_arm_alone_spares_the_gel(laboratory, silent):
    """No curve of the gel is known, the camera sees nothing, an e-Series arm feels."""
    for moment in (MOMENTS[0], MOMENTS[2]):
        result, peak_n = pressed(
            laboratory, silent, moment, TARGETS_N[0], expected=None, sees=False
        )
        assert_found(result, peak_n, silent, TARGETS_N[0])
        assert "the arm (e-series) estimates" in result.reason


def test_an_arm_that_hardly_feels_leaves_the_curve_and_the_camera(laboratory):
    """A CB3: a tenth is found by the curve; a cell that sticks in the search by the camera."""
    result, peak_n = pressed(laboratory, "scale=0.1", MOMENTS[2], TARGETS_N[0], model="cb3")
    assert_found(result, peak_n, "scale=0.1", TARGETS_N[0])
    assert "the gel of gelsight-mini gives" in result.reason
    result, peak_n = pressed(laboratory, "stick-noisily", MOMENTS[0], TARGETS_N[0], model="cb3")
    assert_found(result, peak_n, "stick-noisily", TARGETS_N[0])
    assert "the camera shows contact" in result.reason


def pressed_after_a_true_one(laboratory, silent, target_n):
    """Press the lightest target truly, then another with a cell that lies from its tare on."""
    targets_n = [TARGETS_N[0], target_n]
    lab = of_mini(
        laboratory, 'robot.model="cb3"', targets_n=targets_n, stiffness=1.2, expected=EXPECTED
    )
    peaks_n = []

    def begin():
        lab.world.begin(parse_fault(f"force_sensor:{silent}"))
        peaks_n.append(watch_peak(lab))

    lab.world.when(lambda: len(lab.sink.records) == 1, begin)
    result = lab.run()
    assert lab.sink.records[0].outcome is Outcome.PASSED
    return result, peaks_n[0][-1]


@pytest.mark.parametrize("silent", ["scale=0.4", "scale=0.5", "scale=0.6"])
def test_a_gain_that_falls_after_a_true_press_is_found_on_a_coarse_arm(laboratory, silent):
    """A CB3 and a stiff gel: what the curve alone lets pass, the press before does not."""
    result, peak_n = pressed_after_a_true_one(laboratory, silent, TARGETS_N[1])
    assert_found(result, peak_n, silent, TARGETS_N[1])
    assert "the gel of gelsight-mini gives" in result.reason


@pytest.mark.slow
@pytest.mark.parametrize("target_n", [TARGETS_N[0], TARGETS_N[5]])
def test_silent_faults_that_begin_after_a_true_press_spare_the_gel(laboratory, target_n):
    """A CB3: whatever begins between two presses is found, or harmless."""
    for silent in (*SILENT, "scale=0.4", "scale=0.6", "scale=0.7", "scale=0.8"):
        _, peak_n = pressed_after_a_true_one(laboratory, silent, target_n)
        assert peak_n <= 1.5 * target_n + 0.5, silent


@pytest.mark.slow
@pytest.mark.parametrize("target_n", [TARGETS_N[0], TARGETS_N[5]])
def test_silent_faults_that_begin_in_the_press_spare_the_gel(laboratory, target_n):
    """A CB3 in its first press: each silent, from the middle of the press on."""
    for silent in (*SILENT, "scale=0.4", "scale=0.6"):
        _, peak_n = pressed(laboratory, silent, MOMENTS[3], target_n, model="cb3")
        assert peak_n <= 1.5 * target_n + 0.5, silent


def true_world(laboratory, seed, targets_n):
    """Press in a true world, and say how far the arm may be off [N].

    Any gel within 20 %, any tilt to 2 degrees, 0.2 N of drift.
    """
    draw = random.Random(seed)  # noqa: S311 - a world, not a secret
    model = draw.choice(["e-series", "cb3"])
    lab = laboratory(
        f"protocol.force_targets={[f'{target} N' for target in targets_n]}".replace("'", '"'),
        f'robot.model="{model}"',
        f"emulation.seed={seed}",
        expected=EXPECTED,
        gel=MiniGel(stiffness=draw.uniform(0.8, 1.2), tilt_share=draw.uniform(0.0, 1.0)),
        drift_n_s=draw.choice([-1, 1]) * 0.2 / (25.0 * len(TARGETS_N)),
        noise_n=draw.uniform(0.004, 0.012),
        surface_offset_m=draw.uniform(-0.9e-3, 0.9e-3),
        motion_delay_s=draw.uniform(0.01, 0.05),
        seed=seed,
        ways=SHORT,
    )
    result = lab.run()
    return result, 1.2 if model == "e-series" else 9.0


def assert_witnesses_agree(result, arm_error_n):
    """Every press passed, and lies in the band of the gel and within the arm's own error [N]."""
    assert result.outcome is Outcome.PASSED, result.reason
    for record in result.records:
        least_n, most_n = record.force_expected_n
        assert least_n < record.force_measured_n < most_n
        assert abs(record.arm_force_n - record.force_measured_n) < arm_error_n


@pytest.mark.parametrize(
    "seed", [1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 7))]
)
def test_a_true_press_is_never_called_a_lie(laboratory, seed):
    """Softest to stiffest, straight or leaning, on either arm."""
    result, arm_error_n = true_world(laboratory, seed, (TARGETS_N[0], TARGETS_N[-1]))
    assert len(result.records) == 2
    assert_witnesses_agree(result, arm_error_n)


def test_a_true_press_passes_on_an_arm_of_either_sign(laboratory):
    """The mock arm counts a push as the configuration says, as another controller may."""
    lab = laboratory(
        "robot.force_sign=-1",
        f'protocol.force_targets=["{TARGETS_N[-1]} N"]',
        expected=EXPECTED,
        gel=MiniGel(),
        ways=SHORT,
    )
    result = lab.run()
    assert result.outcome is Outcome.PASSED, result.reason
    assert min(state.tcp_force[2] for state in lab.sink.states) < -3.0
    assert result.records[0].arm_force_n == pytest.approx(TARGETS_N[-1], abs=1.2)


def test_frozen_images_fail_the_trial(laboratory):
    """A loop of old pictures goes unseen by the stream's own checks."""
    lab = laboratory('protocol.force_targets=["1.2556 N"]', expected=None, ways=SHORT)
    silent = parse_fault("camera:repeat-image")
    lab.when_phase("press", lambda: lab.world.begin(silent))
    result = lab.run()
    missed = [c for c in result.records[0].criteria if not c.passed]
    assert [criterion.name for criterion in missed] == ["repeated_frames"]
    assert "an old one" in missed[0].remedy


def test_a_search_goes_no_deeper_than_what_is_known(laboratory):
    """From the second trial on the gel's height is known: a cell that sticks stops there."""
    lab = of_mini(laboratory, 'robot.model="cb3"', targets_n=TARGETS_N[:2], sees=False)
    silent, peaks_n = parse_fault("force_sensor:stick-noisily"), []

    def second_search():
        return [e.trial for e in lab.sink.events if e.detail.get("phase") == "search"][-1:] == [2]

    def begin():
        lab.world.begin(silent)
        peaks_n.append(watch_peak(lab))

    lab.world.when(second_search, begin)
    result = lab.run()
    assert result.reason.startswith("witness.contact_height: nothing was touched")
    assert peaks_n[0][-1] < 1.5 * 1.9511 + 0.5


def test_a_resumed_search_goes_no_deeper_than_what_earlier_sessions_found(laboratory):
    """Two trials passed before, 20 um apart: the first search of this session knows the lower."""
    lab = of_mini(laboratory, 'robot.model="cb3"', targets_n=TARGETS_N[:3], sees=False)
    top_m = lab.config.sensor.surface[2] + 0.9e-3
    first, second, third = fresh_plan(lab.config)
    plan = (
        replace(first, done=True, contact_z_m=top_m - 40e-6),
        replace(second, done=True, contact_z_m=top_m - 20e-6),
        third,
    )
    lab.world.begin(parse_fault("force_sensor:stick-noisily"))
    result = lab.run(plan)
    assert result.reason.startswith("witness.contact_height: nothing was touched")
    searched_m = [state.pose.position[2] for state in lab.sink.states]
    assert min(searched_m) == pytest.approx(top_m - 40e-6 - BEYOND_M, abs=50e-6)
