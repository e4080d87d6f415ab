"""Gradient updates per second of a Stable-Baselines3 SAC, one thread. Prints the rate as JSON.

usage: sac_sb3.py BATCH CRITIC_LAYERS POLICY_LAYERS SECONDS
"""

import json
import sys
import time

import gymnasium
import numpy as np
import stable_baselines3
import torch

torch.set_num_threads(1)
BATCH, CRITIC_LAYERS, POLICY_LAYERS, SECONDS = (int(word) for word in sys.argv[1:5])


class Noise(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (9,), np.float32)
    action_space = gymnasium.spaces.Box(-1, 1, (4,), np.float32)

    def reset(self, seed=None, options=None):
        return np.random.randn(9).astype(np.float32), {}

    def step(self, action):
        return np.random.randn(9).astype(np.float32), float(np.random.randn()), False, False, {}


layers = dict(pi=[256] * POLICY_LAYERS, qf=[256] * CRITIC_LAYERS)
model = stable_baselines3.SAC("MlpPolicy", Noise(), batch_size=BATCH, learning_starts=1, gradient_steps=0, buffer_size=10000, policy_kwargs=dict(net_arch=layers), device="cpu")
model.learn(3000)
torch.set_num_threads(1)
model.train(15, BATCH)
updates, start = 0, time.perf_counter()
while time.perf_counter() < start + SECONDS:
    model.train(10, BATCH)
    updates += 10
print(json.dumps({"who": f"Stable-Baselines3 {stable_baselines3.__version__}", "updates_per_s": updates / (time.perf_counter() - start)}))
