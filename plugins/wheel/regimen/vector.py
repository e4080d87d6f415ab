"""One agent, many environments in one call: `gymnasium.vector.VectorEnv`."""

from __future__ import annotations

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from .simulation import BEGAN, TERMINATED, TRUNCATED, Simulation, one_seat, start
from .spaces import as_space, as_value, observed


class SimulatedVectorEnv(VectorEnv):
    """Simulators with one agent side by side.

    `reset(seed=s)` gives environment `i` the seed `s + i`; a list gives each its own, and `options={"episode": ...}` takes a
    number or a list of them. Each of the environments then does what `SimulatedEnv` does alone.
    """

    def __init__(self, name, config=None, *, num_envs=1, autoreset_mode=AutoresetMode.NEXT_STEP, render_mode=None):
        if render_mode is not None:
            raise ValueError("nothing is rendered here: leave out `render_mode`")
        if num_envs < 1:
            raise ValueError(f"`num_envs` is {num_envs}: at least 1")
        mode = AutoresetMode(autoreset_mode)
        if mode == AutoresetMode.DISABLED:
            raise ValueError("`autoreset_mode` is NEXT_STEP or SAME_STEP; without either use `regimen.make`")
        self.metadata = {"render_modes": [], "autoreset_mode": mode}
        self.render_mode = None
        self.num_envs = num_envs
        self._simulation = Simulation(name, config, num_envs, mode.value)
        self.seat = one_seat(self._simulation)
        self.single_observation_space = observed(self.seat["observation"])
        self.single_action_space = as_space(self.seat["action"])
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._names = [(name, f"_{name}") for name in self._simulation.metrics]
        self._has_seed = False
        # The seed of the trial whose learning environments these are; `None` outside a trial.
        self._learns = None

    def reset(self, *, seed=None, options=None):
        learns = seed is None and not self._has_seed and self._learns is not None
        seeds = self._seeds([self._learns] * self.num_envs if learns else seed)
        slots = range(self.num_envs) if learns else [None] * self.num_envs
        episodes = (options or {}).get("episode")
        episodes = list(np.broadcast_to(episodes, self.num_envs)) if episodes is not None else [None] * self.num_envs
        starts = [start(*of_one) for of_one in zip(seeds, [{"episode": it} for it in episodes], slots, strict=True)]
        return as_value(self.single_observation_space, self._simulation.reset(starts)), {}

    def _seeds(self, seed):
        if isinstance(seed, int | np.integer):
            super().reset(seed=int(seed))
            seed = [int(seed) + place for place in range(self.num_envs)]
        elif seed is None:
            # Streams that never began get a random seed, as in Gymnasium.
            seed = [None if self._has_seed else int(self.np_random.integers(2**63)) for _ in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"{len(seed)} seeds for {self.num_envs} environments")
        self._has_seed = True
        return [None if it is None else int(it) for it in seed]

    def step(self, actions):
        observations, rewards, metrics, standing, last = self._simulation.step(actions)
        standing, rewards = standing[:, 0], rewards[:, 0]
        observations = as_value(self.single_observation_space, observations)
        if not standing.any():
            nobody = np.zeros((2, self.num_envs), bool)
            return observations, rewards, nobody[0], nobody[1], self._of_all(metrics)
        terminations, truncations = standing == TERMINATED, standing == TRUNCATED
        infos = self._infos(metrics, standing, terminations | truncations, last)
        return observations, rewards, terminations, truncations, infos

    def _of_all(self, metrics):
        """Metrics of a step in which no episode ended or began, which is the usual case."""
        infos = {}
        for place, (name, masked) in enumerate(self._names):
            infos[name], infos[masked] = metrics[:, place], np.ones(self.num_envs, bool)
        return infos

    def _infos(self, metrics, standing, ended, last):
        """Metrics with masks; if episodes end and begin in one step, those of the last step are in `final_info`."""
        if self.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP:
            return self._masked(metrics, standing != BEGAN)
        infos = self._masked(metrics, ~ended)
        if ended.any():
            final = np.full(self.num_envs, None, dtype=object)
            for place in np.flatnonzero(ended):
                final[place] = as_value(self.single_observation_space, last[place])
            infos |= {"final_obs": final, "_final_obs": ended.copy()}
            infos |= {"final_info": self._masked(metrics, ended), "_final_info": ended.copy()}
        return infos

    def _masked(self, metrics, mask):
        if not mask.any():
            return {}
        infos = {}
        for place, (name, masked) in enumerate(self._names):
            infos[name], infos[masked] = np.where(mask, metrics[:, place], 0.0), mask.copy()
        return infos

    def state(self):
        """The full states, a row each."""
        return np.array([self._simulation.native.state(place) for place in range(self.num_envs)])
