"""Trains the soft actor-critic of Stable-Baselines3 in the simulator of a trial, where the engine measures it.

Its actions are a box; `regimen.from_logits` makes allocations of them, for the engine too.

usage: sb3_sac.py SEED STEPS EVERY LEARNING_STARTS WIDTH TRAIN_FREQ
"""

import sys

import gymnasium
import numpy as np
import regimen
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback

SEED, STEPS, EVERY, LEARNING_STARTS, WIDTH, TRAIN_FREQ = map(int, sys.argv[1:])

trial = regimen.trial()
shares = regimen.from_logits(trial.environment())
typical = shares.unwrapped.seat["observation"]
center, spread = np.array(typical["center"]), np.array(typical["spread"])
box = gymnasium.spaces.Box(-np.inf, np.inf, shares.observation_space.shape, np.float32)


def scaled(seen):
    """Observations of a size that networks learn from: voltages, currents and powers are not of one size."""
    return ((seen - center) / spread).astype(np.float32)


def act(seen):
    """Allocations of the greedy policy, a row for each episode under way."""
    return shares.func(model.predict(scaled(seen), deterministic=True)[0])


class Measured(BaseCallback):
    """Lets the engine measure where a measurement is due."""

    def _on_step(self):
        if self.num_timesteps % EVERY == 0:
            trial.log(step=self.num_timesteps, own_return=np.mean([episode["r"] for episode in self.model.ep_info_buffer]))
            trial.measure(act, step=self.num_timesteps)
        return True


learned = gymnasium.wrappers.TransformObservation(shares, scaled, box)
networks = {"net_arch": [WIDTH, WIDTH]}
model = SAC("MlpPolicy", learned, learning_starts=LEARNING_STARTS, train_freq=TRAIN_FREQ, policy_kwargs=networks, seed=SEED, device="cpu")
model.learn(STEPS, Measured())
trial.measure(act)
