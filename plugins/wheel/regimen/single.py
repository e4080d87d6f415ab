"""One agent: `gymnasium.Env`."""

from __future__ import annotations

import gymnasium
import numpy as np

from .simulation import TERMINATED, TRUNCATED, Simulation, one_seat, start
from .spaces import as_space, as_value, observed


class SimulatedEnv(gymnasium.Env):
    """A simulator with one agent.

    `reset(seed=s)` makes the same draws as `regimen rollout NAME --seed s`, so that the same actions give the same bits;
    without a seed the stream continues. `reset(seed=s, options={"episode": k})` begins episode `k` of the final
    measurement of a trial with seed `s` of this config, as `regimen rollout --trial ID --episode k` plays it. `info` holds
    the metrics of the step.
    """

    metadata = {"render_modes": []}

    def __init__(self, name, config=None, *, render_mode=None):
        if render_mode is not None:
            raise ValueError("nothing is rendered here: leave out `render_mode`")
        self.render_mode = None
        self._simulation = Simulation(name, config)
        self.seat = one_seat(self._simulation)
        self.observation_space = observed(self.seat["observation"])
        self.action_space = as_space(self.seat["action"])
        self._has_seed = False
        # The seed of the trial whose learning environment this is; `None` outside a trial.
        self._learns = None

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        slot = None
        if seed is None and not self._has_seed:
            slot = None if self._learns is None else 0
            seed = int(self.np_random.integers(2**63)) if slot is None else self._learns
        self._has_seed = True
        observations = self._simulation.reset([start(seed, options, slot)])
        return as_value(self.observation_space, observations[0]), {}

    def step(self, action):
        observations, rewards, metrics, standing, _ = self._simulation.step(action)
        info = dict(zip(self._simulation.metrics, metrics[0].tolist(), strict=True))
        standing = standing[0, 0]
        observation = as_value(self.observation_space, observations[0])
        return observation, float(rewards[0, 0]), bool(standing == TERMINATED), bool(standing == TRUNCATED), info

    def state(self):
        """The full state, which no ordinary policy sees; empty if the simulator declares none."""
        return np.array(self._simulation.native.state(0))
