"""What is refused, and in which words. usage: wheel_refusals.py CASES.json"""

import json
import sys
import tempfile

import gymnasium
import numpy as np
import regimen


def refused(kind, words, call):
    try:
        call()
    except kind as refusal:
        assert words in str(refusal), (words, str(refusal))
        return str(refusal)
    raise AssertionError(f"not refused: {words}")


with open(sys.argv[1]) as file:
    cases = json.load(file)
for case in cases:
    said = refused(regimen.ConfigError, "", lambda: regimen.make("battery", json.loads(case["keys"])))
    assert said.strip() == case["said"].strip(), f"{said}\n--- and the program says\n{case['said']}"
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        file.write(case["keys"])
        file.flush()
        in_file = refused(regimen.ConfigError, file.name, lambda: regimen.make("battery", file.name))
        assert in_file.replace(file.name, "the config of `battery`") == said

with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
    file.write("cells: 3\n")
    file.flush()
    assert regimen.make("battery", file.name).action_space.shape == (3,)
assert regimen.make("battery", {"cells": np.int64(3)}).action_space.shape == (3,)
with tempfile.NamedTemporaryFile("w", suffix=".csv") as file:
    file.write("t_s,power_w\n0,32\n")
    file.flush()
    steady = regimen.make("battery", {"cells": 4, "load": {"file": file.name}})
    steady.reset(seed=0)
    assert 32.0 in steady.step(np.full(4, 0.25))[0]

refused(regimen.ConfigError, "unknown environment `batery`; did you mean `battery`", lambda: regimen.make("batery"))
refused(regimen.ConfigError, "`particles` has 3 agents (agent_0, agent_1, agent_2): use `regimen.make_parallel`", lambda: regimen.make("particles"))
refused(regimen.ConfigError, "use `regimen.make_parallel`", lambda: regimen.make_vec("particles", num_envs=2))
refused(regimen.ConfigError, "`battery` has one agent: use `regimen.make`", lambda: regimen.make_parallel("battery"))
refused(regimen.ConfigError, "`make`: `` names nothing", lambda: regimen.make("python"))
refused(regimen.ConfigError, "there is no data file `absent.csv`", lambda: regimen.make("battery", {"load": {"file": "absent.csv"}}))
refused(regimen.ConfigError, "", lambda: regimen.make("battery", "absent.yaml"))
refused(TypeError, "a config is a mapping or the path of a YAML file, not int", lambda: regimen.make("battery", 4))
refused(TypeError, "not set", lambda: regimen.make("battery", {"cells": {4}}))
refused(ValueError, "not JSON compliant", lambda: regimen.make("battery", {"cells": float("nan")}))
refused(ValueError, "nothing is rendered", lambda: regimen.make("battery", render_mode="human"))

battery = regimen.make("battery")
refused(regimen.EpisodeError, "call `reset`", lambda: battery.step(np.full(4, 0.25)))
for action, words in [
    ([0.5, 0.5, 0.5, 0.5], "the entries sum to 2, not to 1"),
    ([1.5, -0.5, 0.0, 0.0], "entry 2 is -0.5, below 0"),
    ([np.nan, 0.5, 0.5, 0.0], "entry 1 is NaN"),
    ([0.5, 0.5], "2 numbers of actions in place of 4"),
]:
    battery.reset(seed=0)
    refused(regimen.ActionError, words, lambda: battery.step(np.array(action)))
    refused(regimen.EpisodeError, "call `reset`", lambda: battery.step(np.full(4, 0.25)))

grid = regimen.make("grid_reconfiguration")
grid.reset(seed=0)
wrong = np.zeros(12, np.int64)
wrong[3] = 2
refused(regimen.ActionError, "is 2; its options are 0 to 1", lambda: grid.step(wrong))

agents = regimen.make_parallel("inspection_planning")
agents.reset(seed=0)
refused(regimen.ActionError, "no action for component_1", lambda: agents.step({agent: 0 for agent in agents.agents if agent != "component_1"}))
refused(regimen.ActionError, "is no choice", lambda: agents.step(dict.fromkeys(agents.agents, 9)))

# A step after the end.
short = regimen.make("pendulum", {"episode_limit": 1})
short.reset(seed=0)
assert short.step(np.zeros(1))[3]
refused(regimen.EpisodeError, "call `reset`", lambda: short.step(np.zeros(1)))

# An environment that is written in Python passes through Rust and comes back.
with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
    file.write(f"gymnasium=={gymnasium.__version__}\n")
    file.flush()
    config = {"make": "gymnasium:Pendulum-v1", "lock": {"file": file.name}, "interpreter": sys.executable}
    written = regimen.make("python", config)
    start, _ = written.reset(seed=1)
    after = written.step(np.array([0.5]))[0]
    assert start.shape == (3,) and not np.array_equal(start, after)
    assert np.array_equal(written.reset(seed=1)[0], start) and np.array_equal(written.step(np.array([0.5]))[0], after)
