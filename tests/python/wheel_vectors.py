"""Holds vectors against environments that Gymnasium steps one after the other, in both modes, and steps them beside another thread."""

import pickle
import threading

import gymnasium
import numpy as np
import regimen
from gymnasium.vector import AutoresetMode, SyncVectorEnv

CASES = [
    ("battery", {"cells": 3, "decision_interval_s": 60}, 120),
    ("pendulum", {"episode_limit": 7}, 30),
    ("allocation_bandit", {}, 6),
    ("grid_reconfiguration", {}, 30),
    ("image_samples", {}, 5),
    ("turbofan_calibration", {}, 20),
]


def same(ours, theirs, place):
    """Arrays, numbers and infos alike, to the bit."""
    if isinstance(theirs, dict):
        assert ours.keys() == theirs.keys(), (place, ours.keys() ^ theirs.keys())
        for key, value in theirs.items():
            same(ours[key], value, f"{place}, {key}")
    elif isinstance(theirs, np.ndarray) and theirs.dtype == object:
        for one, other in zip(ours, theirs, strict=True):
            assert (one is None) == (other is None), place
            assert other is None or np.array_equal(one, other), place
    else:
        assert np.array_equal(ours, theirs), (place, ours, theirs)


for name, config, steps in CASES:
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP):
        ours = regimen.make_vec(name, config, num_envs=3, autoreset_mode=mode)
        theirs = SyncVectorEnv([lambda: regimen.make(name, config)] * 3, autoreset_mode=mode)
        assert ours.metadata["autoreset_mode"] is mode
        assert ours.single_action_space == theirs.single_action_space
        assert ours.observation_space.shape == theirs.observation_space.shape
        ours.action_space.seed(5)
        same(ours.reset(seed=3)[0], theirs.reset(seed=3)[0], f"{name}, reset")
        ended, kept = 0, []
        for step in range(steps):
            actions = ours.action_space.sample()
            assert ours.action_space.contains(actions)
            answers = ours.step(actions), theirs.step(actions)
            for part, one, other in zip(("observations", "rewards", "terminations", "truncations", "infos"), *answers):
                same(one, other, f"{name}, {mode}, step {step}, {part}")
            ended += int((answers[0][2] | answers[0][3]).sum())
            kept.append((answers[0][0], answers[0][0].copy()))
        assert ended > 0 or name == "turbofan_calibration", name
        assert all(np.array_equal(given, copy) for given, copy in kept), "what was given out is written to by nobody"

# What is not a mode of ours, and what does not fit.
for wrong in (
    lambda: regimen.make_vec("battery", autoreset_mode=AutoresetMode.DISABLED),
    lambda: regimen.make_vec("battery", num_envs=0),
    lambda: regimen.make_vec("battery", num_envs=2).reset(seed=[1, 2, 3]),
    lambda: regimen.make_vec("battery", render_mode="human"),
):
    try:
        wrong()
    except ValueError as refusal:
        assert str(refusal), refusal
    else:
        raise AssertionError("not refused")

# A refused action leaves no episode under way, in none of the environments, and the message names the one.
vector = regimen.make_vec("battery", num_envs=3)
vector.reset(seed=0)
actions = vector.action_space.sample()
actions[2] = 0.5
try:
    vector.step(actions)
except regimen.ActionError as refusal:
    assert "environment 2: the entries sum to 2, not to 1" in str(refusal), refusal
try:
    vector.step(vector.action_space.sample())
except regimen.EpisodeError as refusal:
    assert "no episode is under way in environment 0: call `reset`" in str(refusal), refusal
else:
    raise AssertionError("stepped on")

# Allocations for agents of boxes, alone and side by side.
alone, several = regimen.from_logits(regimen.make("battery")), regimen.from_logits(regimen.make_vec("battery", num_envs=2))
assert alone.action_space == several.single_action_space == gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)
alone.reset(seed=0), several.reset(seed=[0, 1])
logits = np.array([1.0, -1.0, 0.0, 0.5], np.float32)
shares = alone.action(logits)
assert abs(shares.sum() - 1) < 1e-15 and np.allclose(np.log(shares / shares[2]), 3 * logits, atol=1e-12)
assert np.array_equal(alone.step(logits)[0], several.step(np.array([logits, logits]))[0][0])
try:
    regimen.from_logits(regimen.make("pendulum"))
except TypeError as refusal:
    assert "for allocations" in str(refusal)
else:
    raise AssertionError("not refused")
simplex = several.unwrapped.action_space
assert simplex == pickle.loads(pickle.dumps(simplex)) and simplex != regimen.Simplex((2, 3))
assert not regimen.Simplex((2,)).contains(np.array([0.5, 0.6])) and regimen.Simplex((2,)).contains(np.array([0.5, 0.5]))

# While Rust steps, other threads go on.
engines = regimen.make_vec("turbofan_calibration", num_envs=8)
engines.reset(seed=0)
under_way, done, counted = threading.Event(), threading.Event(), 0


def many_steps():
    under_way.set()
    for _ in range(20):
        engines.step(engines.action_space.sample())
    done.set()


worker = threading.Thread(target=many_steps)
worker.start()
under_way.wait()
while not done.is_set():
    counted += 1
worker.join()
assert counted > 1000, counted
