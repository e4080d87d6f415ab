"""The environment of a maintenance engineer, of the study `python-rule`."""

import gymnasium
import numpy as np


class Pump(gymnasium.Env):
    """A pump wears by chance. It earns 1 in a step in which it runs, costs 2 when it is mended, and 10 when it breaks."""

    observation_space = gymnasium.spaces.Box(0.0, 1.0, (1,), np.float64)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.wear, self.steps = 0.0, 0
        return np.array([self.wear]), {}

    def step(self, action):
        self.steps += 1
        reward = 1.0 if action == 0 else -2.0
        self.wear = 0.0 if action == 1 else self.wear + self.np_random.uniform(0.0, 0.3)
        if self.wear >= 1.0:
            reward, self.wear = -10.0, 0.0
        return np.array([self.wear]), reward, False, self.steps == 50, {}
