"""Plays what the registry played and compares every bit; then Gymnasium and PettingZoo check each environment.

usage: wheel_environments.py CASES.json
"""

import json
import sys
import warnings

import gymnasium
import numpy as np
import regimen
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test

with open(sys.argv[1]) as file:
    told = json.load(file)


def flat(value):
    """An observation, or those of all agents, as one list of numbers."""
    values = value.values() if isinstance(value, dict) else [value]
    return np.concatenate([np.atleast_1d(np.asarray(it, np.float64)) for it in values]).tolist()


def single(environment, asked):
    action = np.array(asked) if isinstance(environment.action_space, gymnasium.spaces.Box) else np.array(asked).astype(np.int64)
    action = action[0] if isinstance(environment.action_space, gymnasium.spaces.Discrete) else action
    assert environment.action_space.contains(action), (environment.action_space, action)
    seen, reward, terminated, truncated, info = environment.step(action)
    assert type(reward) is float and type(terminated) is bool and type(truncated) is bool
    assert environment.observation_space.contains(seen), (environment.observation_space, seen)
    return seen, [reward], terminated, truncated, list(info.values())


def several(environment, asked):
    actions, rest = {}, list(asked)
    for agent in environment.agents:
        space = environment.action_space(agent)
        own = [rest.pop(0) for _ in range(int(np.prod(space.shape)))]
        actions[agent] = np.array(own) if isinstance(space, gymnasium.spaces.Box) else int(own[0])
        assert space.contains(actions[agent]), (space, actions[agent])
    agents = list(environment.agents)
    seen, rewards, terminated, truncated, infos = environment.step(actions)
    assert list(seen) == list(rewards) == agents
    assert all(environment.observation_space(agent).contains(seen[agent]) for agent in agents)
    assert len({tuple(info.items()) for info in infos.values()}) == 1
    ended = terminated[agents[0]] or truncated[agents[0]]
    assert environment.agents == ([] if ended else agents)
    return seen, list(rewards.values()), terminated[agents[0]], truncated[agents[0]], list(infos[agents[0]].values())


def made(case):
    try:
        return regimen.make(case["name"], case["config"]), single
    except regimen.ConfigError as refusal:
        assert "use `regimen.make_parallel`" in str(refusal), refusal
        return regimen.make_parallel(case["name"], case["config"]), several


assert list(regimen.environments()) == told["names"]
kinds = {}
for case in told["cases"]:
    environment, step = made(case)
    kinds[case["name"]] = step
    for number, episode in enumerate(case["episodes"]):
        seen, _ = environment.reset(seed=case["seed"]) if number == 0 else environment.reset()
        place = f"{case['name']} {case['config']}, episode {number}"
        assert flat(seen) == episode["start"], place
        for decision, expected in enumerate(episode["steps"], 1):
            seen, rewards, terminated, truncated, metrics = step(environment, expected["asked"])
            place = f"{case['name']} {case['config']}, episode {number}, decision {decision}"
            assert flat(seen) == expected["observations"], place
            assert rewards == expected["rewards"] and metrics == expected["metrics"], place
            assert (terminated, truncated) == (expected["terminated"], expected["truncated"]), place
            assert environment.state().tolist() == expected["state"], place
    # The same seed again begins the same episode, whatever happened meanwhile.
    assert flat(environment.reset(seed=case["seed"])[0]) == case["episodes"][0]["start"], case["name"]

    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        # Physical quantities may have no limits, and some of them are constant.
        warnings.filterwarnings("ignore", message=".*Box")
        if step is single:
            # By Gymnasium's own name: then it compares observations of one seed, too.
            version = regimen.environments()[case["name"]]["version"]
            check_env(gymnasium.make(f"regimen/{case['name']}-v{version}", config=case["config"], disable_env_checker=True).unwrapped)
        else:
            parallel_api_test(environment, num_cycles=100)
            parallel_seed_test(lambda case=case: regimen.make_parallel(case["name"], case["config"]), num_cycles=20)
assert set(kinds.values()) == {single, several}

# With Gymnasium's wrappers, and as a vector.
version = regimen.environments()["battery"]["version"]
with gymnasium.make(f"regimen/battery-v{version}", config={"cells": 2}) as environment:
    assert environment.unwrapped.action_space.shape == (2,)
    assert environment.reset(seed=1)[0].shape == environment.observation_space.shape
vector = gymnasium.make_vec(f"regimen/battery-v{version}", num_envs=3, config={"cells": 2})
assert isinstance(vector, regimen.SimulatedVectorEnv) and vector.reset(seed=1)[0].shape[0] == 3
