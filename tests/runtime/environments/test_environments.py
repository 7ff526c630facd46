"""The environments of a tactile pad: what Gymnasium asks of them, what is learnable, and how episodes end."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import softprint
from softprint.runtime.environments import FindEdgeEnv, PressToForceEnv
from softprint.runtime.environments.find_edge import rectangle_distance
from softprint.runtime.environments.scripted import find_edge, nearest_edge, press_to_force
from tests.toy_experiment import write_experiment

SIZES = {"markers": (6, 5), "image": (48, 36)}


@pytest.fixture(scope="module")
def press():
    return PressToForceEnv(
        model="bare", observe=("markers", "depth", "force"), render_mode="rgb_array", **SIZES
    )


@pytest.fixture(scope="module")
def edge():
    return FindEdgeEnv(model="mechanics", **SIZES)


def played(env, policy, seed):
    """Observations, rewards, and the last info of an episode."""
    seen, info = env.reset(seed=seed)
    observations, rewards, over = [seen], [], False
    env.action_space.seed(seed)
    while not over:
        seen, reward, success, stopped, info = env.step(policy(env, seen))
        observations.append(seen)
        rewards.append(reward)
        over = success or stopped
    return observations, rewards, info


def at_random(env, seen):
    return env.action_space.sample()


def test_gymnasium_finds_nothing_wrong(press) -> None:
    check_env(press, skip_render_check=True)  # which would make it anew, without its arguments


def test_a_scripted_policy_presses_to_the_force_and_a_random_one_does_not(press) -> None:
    for seed in range(3):
        observations, rewards, info = played(press, press_to_force, seed)
        assert info["success"]
        assert info["force"] == pytest.approx(float(observations[0]["target"][0]), rel=press.tolerance)
        assert len(rewards) < 80
        assert rewards[-1] > 9.9  # that of success, less a small error
        assert not played(press, at_random, seed)[2]["success"]


@pytest.mark.slow
def test_a_scripted_policy_finds_the_edge_and_a_random_one_does_not(edge) -> None:
    for seed in range(2):
        _, rewards, info = played(edge, find_edge, seed)
        assert info["success"]
        assert abs(info["distance_mm"]) < 1e3 * edge.tolerance
        assert len(rewards) < 60
    assert not played(edge, at_random, 0)[2]["success"]


def test_an_episode_is_the_same_again_and_another_with_another_seed(press) -> None:
    once, again, other = (played(press, press_to_force, seed) for seed in (5, 5, 6))
    assert once[1] == again[1]
    for a, b in zip(once[0], again[0], strict=True):
        for name in a:
            np.testing.assert_array_equal(a[name], b[name])
    assert once[1] != other[1]


def test_observations_are_what_was_asked_for(press) -> None:
    seen, _ = press.reset(seed=1)
    assert {name: value.shape for name, value in seen.items()} == {
        "markers": (30, 3),
        "depth": (36, 48),
        "force": (3,),
        "indenter": (6,),
        "target": (1,),
    }
    assert all(value.dtype == np.float32 for value in seen.values())
    np.testing.assert_allclose(seen["indenter"][:3], 1e3 * press.position, rtol=1e-6)
    np.testing.assert_allclose(seen["depth"], 0.0, atol=1e-3)  # mm, under its weight
    assert not seen["force"].any()


@pytest.mark.parametrize("action", [[np.nan, 0.0, 0.0], [0.0, 0.0], 0.5], ids=["nan", "two", "one"])
def test_an_action_that_is_none_changes_nothing(press, action) -> None:
    press.reset(seed=1)
    start, poses = press.position.copy(), len(press.poses)
    with pytest.raises(softprint.SoftprintError, match="an action is 3 finite numbers, not"):
        press.step(np.array(action, dtype=np.float32))
    assert np.array_equal(press.position, start)
    assert len(press.poses) == poses
    press.step(np.zeros(3, dtype=np.float32))


def test_time_runs_out(press) -> None:
    _, _, info = played(press, lambda env, seen: np.zeros(3, np.float32), 0)
    assert info["reason"] == f"{press.max_steps} steps are over"
    assert info["status"] == "CONVERGED"
    assert not info["success"]


def test_a_step_that_fails_truncates_with_a_reason(press, monkeypatch) -> None:
    press.reset(seed=0)
    monkeypatch.setattr(press, "lower", np.array([-0.008, -0.006, -0.05]))
    monkeypatch.setattr(press, "speed", 0.2)
    for _ in range(20):  # far through the pad
        _, _, success, truncated, info = press.step(np.array([0.0, 0.0, -1.0], np.float32))
        if truncated:
            break
    assert truncated
    assert not success
    assert info["status"] != "CONVERGED"
    assert len(info["reason"]) > 40  # a sentence with advice


def test_a_picture_shows_the_dent(press) -> None:
    press.reset(seed=0)
    flat = press.render()
    played(press, press_to_force, 0)
    dented = press.render()
    assert flat.shape == dented.shape == (36 * 8, 48 * 8, 3)
    assert flat.dtype == np.uint8
    assert dented.astype(int).sum() > 1.05 * flat.astype(int).sum()  # deeper is brighter


@pytest.mark.slow
def test_several_run_in_processes_of_their_own() -> None:
    softprint.register_environments()
    make = gymnasium.vector.AsyncVectorEnv
    keys = {"model": "bare", "observe": ("force",), **SIZES}
    one = gymnasium.make("softprint/PressToForce-v0", **keys)
    seen, _ = one.reset(seed=3)
    envs = make(
        [lambda: gymnasium.make("softprint.runtime.environments:softprint/PressToForce-v0", **keys)] * 2,
        context="spawn",
    )
    try:
        together, _ = envs.reset(seed=[3, 4])
        np.testing.assert_array_equal(together["indenter"][0], seen["indenter"])
        down = np.array([0.0, 0.0, -1.0], np.float32)
        for _ in range(4):
            seen, reward, *_ = one.step(down)
            together, rewards, *_ = envs.step(np.stack([down, -down]))
        np.testing.assert_array_equal(together["force"][0], seen["force"])
        assert rewards[0] == reward
        assert seen["force"][2] < 0
        assert together["force"][1, 2] == 0
    finally:
        envs.close()


def test_arguments_that_make_no_sense_are_refused(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for keys, words in (
        ({"observe": ("smell",)}, "must be some of markers, depth, force"),
        ({"observe": "force"}, "must be some of"),
        ({"render_mode": "human"}, "must be rgb_array"),
        ({"max_steps": 0}, "must be positive"),
        ({"model": "ours"}, "without an experiment there are only bare and mechanics"),
        ({"experiment": "no.toml"}, "no.toml"),
    ):
        with pytest.raises(softprint.SoftprintError, match=words):
            PressToForceEnv(**keys)


def test_a_pad_of_another_experiment_is_refused(tmp_path) -> None:
    """Its body would be pressed under the contact and the dynamics of this one."""
    path = write_experiment(tmp_path, 3)
    experiment = softprint.load_experiment(path)
    body = softprint.build_body(experiment.body, experiment.base_dir, experiment.seed)
    softprint.save_body(tmp_path / "run" / "body.h5", body)
    path.write_text(path.read_text().replace("young = 2e4", "young = 3e4"))
    with pytest.raises(softprint.SoftprintError, match="its material differs"):
        PressToForceEnv(experiment=str(path), run=str(tmp_path / "run"), model="bare")


def test_the_outline_of_the_block() -> None:
    half = np.array([3.0, 4.0])
    for point, distance in (([0, 0], -3.0), ([5, 0], 2.0), ([0, -4.5], 0.5), ([6, 8], 5.0)):
        assert rectangle_distance(np.array(point, float), half) == pytest.approx(distance)


def test_the_nearest_edge_in_an_image() -> None:
    pressed = np.zeros((4, 6), bool)
    pressed[:, 4:] = True  # the right third of 6 x 4 mm
    np.testing.assert_allclose(nearest_edge(pressed, np.array([6.0, 4.0]))[0], 1.0)
    pressed = np.zeros((4, 6), bool)
    pressed[:1] = True  # the upper quarter
    np.testing.assert_allclose(nearest_edge(pressed, np.array([6.0, 4.0]))[1], 1.0)
    assert not nearest_edge(np.ones((4, 6), bool), np.array([6.0, 4.0])).any()
