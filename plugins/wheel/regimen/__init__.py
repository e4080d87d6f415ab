"""The simulators of regimen as environments of Gymnasium and PettingZoo, stepped in Rust.

    import regimen

    env = regimen.make("battery", {"cells": 4})                     # gymnasium.Env
    envs = regimen.make_vec("battery", {"cells": 4}, num_envs=64)   # gymnasium.vector.VectorEnv, one call for all
    game = regimen.make_parallel("particles")                       # pettingzoo.ParallelEnv

    trial = regimen.trial()                                         # of a program that is an agent of a study

Names and configs are those of a study. `gymnasium.make("regimen/battery-v2", config={"cells": 4})` makes the same
environment; its version is the version of the environment's numbers.
"""

from __future__ import annotations

import json
import os

import gymnasium
from gymnasium.vector import AutoresetMode

from ._native import ActionError, ConfigError, EpisodeError, SimulationError
from ._native import collect as _collect
from ._native import environments as _environments
from ._trial import Trial, trial
from .single import SimulatedEnv
from .spaces import Simplex, from_logits
from .vector import SimulatedVectorEnv

__all__ = [
    "ActionError",
    "ConfigError",
    "EpisodeError",
    "Simplex",
    "SimulatedEnv",
    "SimulatedVectorEnv",
    "SimulationError",
    "Trial",
    "collect",
    "environments",
    "from_logits",
    "make",
    "make_parallel",
    "make_vec",
    "trial",
]


def collect(study, *, profile=None, set=(), store=None):
    """The trials of a study: for each its names and seed, its end state (`None` if it has not run), and the mean of
    every metric of its final measurement, in one flat mapping, as `pandas.DataFrame` takes them.

    `profile` and `set` are those of `regimen run`; the store is that of the machine unless one is named. Nothing is
    run. Raises `ConfigError` in the words of `regimen check`.
    """
    sets = [set] if isinstance(set, str) else list(set)
    rows = json.loads(_collect(os.fspath(study), profile, sets, None if store is None else os.fspath(store)))
    for row in rows:
        row.update(row.pop("final"))
    return rows


def environments():
    """Every registered environment: its name with the version of its numbers and a line about it."""
    return {name: {"version": version, "about": about} for name, version, about in _environments()}


def make(name, config=None, *, render_mode=None):
    """An environment of one agent.

    `config` is a mapping with the keys of a study, or the path of a YAML file with them; keys that are left out have
    their defaults. Raises `ConfigError`, which names the problem and the remedy in the words of `regimen check`.
    """
    return SimulatedEnv(name, config, render_mode=render_mode)


def make_vec(name, config=None, *, num_envs=1, autoreset_mode=AutoresetMode.NEXT_STEP, render_mode=None):
    """`num_envs` environments of one agent, stepped in one call."""
    return SimulatedVectorEnv(name, config, num_envs=num_envs, autoreset_mode=autoreset_mode, render_mode=render_mode)


def make_parallel(name, config=None, *, render_mode=None):
    """An environment of several agents, by PettingZoo's parallel interface."""
    from .parallel import SimulatedParallelEnv

    return SimulatedParallelEnv(name, config, render_mode=render_mode)


for _name, _version, _ in _environments():
    gymnasium.register(
        f"regimen/{_name}-v{_version}",
        entry_point="regimen:make",
        vector_entry_point="regimen:make_vec",
        kwargs={"name": _name},
    )
