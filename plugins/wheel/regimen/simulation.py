"""The common part of all interfaces: a row of environments in Rust, and the arrays that pass to it and back."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping

import numpy as np

from . import _native

TERMINATED, TRUNCATED, BEGAN = 1.0, 2.0, 3.0


class Simulation:
    """Environments of one config side by side."""

    def __init__(self, name, config=None, count=1, autoreset="Disabled"):
        keys, file = as_text(config)
        self.native = _native.Simulation(name, keys, file, count, autoreset)
        self.name = name
        self.seats = self.native.seats()
        self.metrics = [metric["name"] for metric in self.native.metrics()]
        self._count = count
        ends = np.cumsum([0] + [count * columns for columns in self.native.columns()])
        self._sections = [
            (slice(start, end), (count, columns))
            for start, end, columns in zip(ends, ends[1:], self.native.columns(), strict=False)
        ]
        self._total = int(ends[-1])

    def reset(self, starts):
        """Observations of all seats of each environment, a row each; `starts` has the result of `start` for each."""
        observations = np.empty(self._sections[0][1])
        self.native.reset(starts, observations)
        return observations

    def step(self, actions):
        """Observations, rewards, metrics, states of episodes, and last observations, a row per environment each.

        They are views of one new array, which is never written to again.
        """
        outcome = np.empty(self._total)
        self.native.step(np.asarray(actions, np.float64, order="C").reshape(-1), outcome)
        return [outcome[place].reshape(shape) for place, shape in self._sections]


def as_text(config):
    """A config as the text of its keys, or as the path of a file."""
    if config is None:
        return None, None
    if isinstance(config, Mapping):
        return json.dumps(config, indent=2, allow_nan=False, default=_plain), None
    if isinstance(config, str | os.PathLike):
        return None, os.fspath(config)
    raise TypeError(f"a config is a mapping or the path of a YAML file, not {type(config).__name__}")


def _plain(value):
    """Numbers and arrays of NumPy, paths and other mappings as JSON has them."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"a config holds numbers, words, lists and mappings, not {type(value).__name__}: {value!r}")


def one_seat(simulation):
    """The only seat of an environment, for interfaces of one agent."""
    if len(simulation.seats) != 1:
        names = ", ".join(seat["name"] for seat in simulation.seats)
        raise _native.ConfigError(
            f"`{simulation.name}` has {len(simulation.seats)} agents ({names}): use `regimen.make_parallel`"
        )
    return simulation.seats[0]


def start(seed, options, slot=None):
    """A seed with the episode that `options` ask for, or the slot in which a trial learns."""
    episode = (options or {}).get("episode")
    return seed, None if episode is None else int(episode), slot
