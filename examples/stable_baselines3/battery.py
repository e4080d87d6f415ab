"""Trains the soft actor-critic of Stable-Baselines3 to share a load among the four cells of a battery pack.

Its actions are a box; `regimen.from_logits` makes shares of the load of them. Every policy is measured on the same episodes, which are
those of a study's final measurement with seed 0, beside an equal split.

usage: battery.py [STEPS]
"""

import sys

import gymnasium
import numpy as np
import regimen
from stable_baselines3 import SAC

STEPS = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
CONFIG = {"cells": 4}
EPISODES = 20


def scaled(environment):
    """Observations of a size that networks learn from: voltages, currents and powers are not of one size."""
    center, spread = np.array(environment.unwrapped.seat["observation"]["center"]), np.array(environment.unwrapped.seat["observation"]["spread"])
    space = gymnasium.spaces.Box(-np.inf, np.inf, environment.observation_space.shape, np.float32)
    return gymnasium.wrappers.TransformObservation(environment, lambda seen: ((seen - center) / spread).astype(np.float32), space)


def lifetimes(environment, act):
    """Decisions that the pack survives, episode by episode."""
    lengths = []
    for episode in range(EPISODES):
        seen, _ = environment.reset(seed=0, options={"episode": episode})
        length, ended = 0, False
        while not ended:
            seen, _, terminated, truncated, _ = environment.step(act(seen))
            length, ended = length + 1, terminated or truncated
        lengths.append(length)
    return lengths


environment = scaled(regimen.from_logits(regimen.make("battery", CONFIG)))
model = SAC("MlpPolicy", environment, learning_starts=500, batch_size=128, policy_kwargs={"net_arch": [64, 64]}, seed=0, device="cpu")
model.learn(STEPS)

equal = np.zeros(environment.action_space.shape, np.float32)
for name, act in (("equal split", lambda _: equal), ("soft actor-critic", lambda seen: model.predict(seen, deterministic=True)[0])):
    print(f"{name}: {np.mean(lifetimes(environment, act)):.1f} decisions, mean of {EPISODES} episodes")
