"""Environments of touch follow Gymnasium's contract, and one batch is many single ones."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tacauchy_rig.core.config.load import default_text, load_config
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.envs.gym_imperfections import Imperfections, imperfections_of_run
from tacauchy_rig.envs.gym_tasks import FindEdge, PegTouch, PressToForce
from tests.reports import conftest as made

_STEPS = 6


@pytest.fixture(scope="module")
def three() -> Iterator[PressToForce]:
    """Three environments of a sensor with every imperfection."""
    made = gymnasium.make_vec(
        "PressToForce-v0", num_envs=3, vectorization_mode="vector_entry_point", image=True
    )
    assert isinstance(made, PressToForce)
    made.imperfections = Imperfections(
        noise=(0.01,) * 6,
        zero=(0.02,) * 6,
        drift_n_s=0.01,
        gain=0.1,
        force_delay_s=0.02,
        image_delay_s=0.04,
        image_noise=2.0,
        stiffness=0.1,
    )
    yield made
    made.close()


def _played(env: PressToForce, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return forces, images and rewards of presses downwards."""
    seen, _ = env.reset(seed=seed)
    found = []
    for _ in range(_STEPS):
        env.poses[:, 2] -= 0.3e-3
        seen, rewards, *_ = env.step(np.zeros((env.num_envs, 3)))
        assert env.observation_space.contains(seen)
        found.append((seen["force"], seen["image"], rewards))
    forces, images, rewards = zip(*found, strict=True)
    return np.array(forces), np.array(images), np.array(rewards)


def test_a_seed_repeats_exactly_and_another_differs(three: PressToForce) -> None:
    """Forces, images and rewards, with all of what is drawn."""
    first, again, other = (_played(three, seed) for seed in (5, 5, 6))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first[0], other[0])
    assert first[0][-1, :, 2].max() > 0.1, "the presses are felt"
    np.testing.assert_allclose(first[0][:, 1], other[0][:, 0], atol=2e-3)


def test_an_episode_begins_anew_in_the_step_that_ends_it(three: PressToForce) -> None:
    """The last observation is in the info, the new episode's is without contact."""
    three.reset(seed=5)
    three._limit = 4
    for _ in range(4):
        three.poses[:, 2] -= 0.5e-3
        seen, _, _, cut, info = three.step(np.zeros((3, 3)))
    three._limit = None
    assert cut.all()
    assert info["_final_obs"].all()
    assert min(each["force"][2] for each in info["final_obs"]) > 0.2
    assert np.abs(seen["force"][:, 2]).max() < 0.2
    assert not seen["pose"].any()


@pytest.mark.parametrize("name", ["PressToForce-v0", "FindEdge-v0", "PegTouch-v0"])
def test_gymnasiums_checker_passes(name: str) -> None:
    """Of each task."""
    check_env(gymnasium.make(name).unwrapped, skip_render_check=True)


def test_time_is_limited_and_an_image_is_drawn() -> None:
    """Of a single environment, which draws what it is asked to."""
    made = gymnasium.make("PressToForce-v0", render_mode="rgb_array", max_episode_steps=2)
    made.reset(seed=1)
    assert not made.step(np.zeros(3, np.float32))[3]
    vector = made.unwrapped.vector
    vector.poses[:, 2] = vector.pad.height_m - 0.5e-3
    assert made.step(np.zeros(3, np.float32))[3]
    image = made.render()
    assert image.shape == (240, 320, 3)
    assert image.std() > 1.0, "the press is seen"


def test_an_edge_is_found_over_the_middle_under_load() -> None:
    """The reward is the distance; the task ends where the edge is."""
    made = FindEdge(1, image=False)
    made.reset(seed=2)
    made.poses[0, :3] = [-made.goal[0, 0] * 2e-3, 0.0, made.pad.height_m - 0.3e-3]
    _, rewards, done, _ = made.advance(np.zeros((1, 3)))
    assert rewards[0] == pytest.approx(-2.0)
    assert not done[0]
    made.poses[0, 0] = -made.goal[0, 0] * 4e-3
    seen, _, done, _ = made.advance(np.zeros((1, 3)))
    assert done[0]
    assert seen["force"][0, 4] * made.poses[0, 0] < 0.0, "the force acts off the middle"


def test_a_pegs_pose_is_felt_and_judged() -> None:
    """The truth earns nothing off; the force's moment changes with the turn."""
    made = PegTouch(2, image=False)
    made.reset(seed=3)
    made.poses[:, 2] = made.surface_m - 0.3e-3
    right = np.hstack([np.zeros((2, 3)), made.truth])
    seen, rewards, _, cut = made.advance(right)
    assert not cut.any()
    np.testing.assert_allclose(rewards, 0.0, atol=1e-9)
    assert (seen["force"][:, 2] > 0.1).all()
    assert (made.advance(-right)[1] < -0.1).all()


def test_a_run_tells_noise_zero_and_drift(tmp_path: Path) -> None:
    """Of its tares; a run without trials tells nothing."""
    text = default_text()
    run = RunStore.create(
        tmp_path, load_config(), config_text=text, simulated=True, versions={"tacauchy-rig": "0"}
    )
    path = run.paths.recording(1, 1)
    path.parent.mkdir(parents=True)
    made.write_recording(path, made)
    with pytest.raises(RecordError, match="no trial was tared"):
        imperfections_of_run(run.paths.root)
    after = replace(made.TARE, mean=(0, 0, made.TARE_N + 0.02, 0, 0, 0), start_ns=made.at(10.0))
    run.save_result(replace(made.record(1), tare_after=replace(after, end_ns=made.at(11.0))))
    found = imperfections_of_run(run.paths.root)
    assert found.noise == pytest.approx((0.007,) * 6)
    assert found.zero == pytest.approx((0.0007,) * 6)
    assert found.drift_n_s == pytest.approx(0.002)
    assert found.image_noise == 0.0, "its frames are the same picture"
