"""Several agents: PettingZoo's parallel interface."""

from __future__ import annotations

import numpy as np
from pettingzoo import ParallelEnv

from ._native import ActionError, ConfigError
from .simulation import TERMINATED, TRUNCATED, Simulation, start
from .spaces import as_space, as_value, n_observed, observed


class SimulatedParallelEnv(ParallelEnv):
    """A simulator with several agents, all of which stay until the episode ends.

    Seeds and episodes are those of `SimulatedEnv`. The metrics of a step belong to all agents, and are in the `infos`
    of each.
    """

    def __init__(self, name, config=None, *, render_mode=None):
        if render_mode is not None:
            raise ValueError("nothing is rendered here: leave out `render_mode`")
        self.render_mode = None
        self.metadata = {"name": name, "render_modes": [], "is_parallelizable": True}
        self._simulation = Simulation(name, config)
        seats = self._simulation.seats
        if len(seats) == 1:
            raise ConfigError(f"`{name}` has one agent: use `regimen.make`")
        self.possible_agents = [seat["name"] for seat in seats]
        self.agents = []
        self.observation_spaces = {seat["name"]: observed(seat["observation"]) for seat in seats}
        self.action_spaces = {seat["name"]: as_space(seat["action"]) for seat in seats}
        ends = np.cumsum([n_observed(seat["observation"]) for seat in seats]).tolist()
        self._places = dict(zip(self.possible_agents, map(slice, [0, *ends], ends), strict=False))
        self.state_space = as_space(self._simulation.native.state_space())
        self._random = None

    def observation_space(self, agent):
        return self.observation_spaces[agent]

    def action_space(self, agent):
        return self.action_spaces[agent]

    def reset(self, seed=None, options=None):
        if seed is None and self._random is None:
            seed = int(np.random.default_rng().integers(2**63))
        if seed is not None:
            self._random = seed
        observations = self._simulation.reset([start(seed, options)])
        self.agents = list(self.possible_agents)
        return self._seen(observations[0]), {agent: {} for agent in self.agents}

    def step(self, actions):
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise ActionError(f"no action for {', '.join(missing)}: every agent acts in every step")
        asked = [np.atleast_1d(np.asarray(actions[agent], np.float64)) for agent in self.agents]
        observations, rewards, metrics, standing, _ = self._simulation.step(np.concatenate(asked or [np.empty(0)]))
        standing, names = standing[0, 0], self._simulation.metrics
        agents, everyone = self.agents, self._everyone
        infos = {agent: dict(zip(names, metrics[0].tolist(), strict=True)) for agent in agents}
        earned = dict(zip(agents, rewards[0].tolist(), strict=True))
        if standing in (TERMINATED, TRUNCATED):
            self.agents = []
        return self._seen(observations[0]), earned, everyone(standing == TERMINATED), everyone(standing == TRUNCATED), infos

    def state(self):
        """The full state, which no ordinary policy sees."""
        return np.array(self._simulation.native.state(0))

    def _seen(self, numbers):
        return {
            agent: as_value(self.observation_spaces[agent], numbers[place]) for agent, place in self._places.items()
        }

    def _everyone(self, value):
        return dict.fromkeys(self.possible_agents, bool(value))
