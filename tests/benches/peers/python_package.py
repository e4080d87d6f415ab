"""Steps per second of processor time of simulators that are stepped from Python, one thread. Prints the rate as JSON.

`regimen` is the Python package of this repository. The others are originals in NumPy: `gymnasium` its own pendulum, one after the other where there
are several, `numpy` a plain pendulum of all environments at once, as somebody would write it by hand, `mpe2` its cooperative navigation and
`progpy` its battery cell, whose rate is in simulated seconds of a cell.

usage: python_package.py regimen|gymnasium|numpy|mpe2|progpy pendulum|particles|battery COUNT SECONDS
"""

import importlib.metadata
import json
import sys
import time

import gymnasium
import numpy as np

WHO, WHAT, COUNT, SECONDS = sys.argv[1], sys.argv[2], int(sys.argv[3]), float(sys.argv[4])


class Pendulums:
    """Pendulum-v1 for arrays of angles and speeds, with episodes of 200 steps that begin together."""

    def __init__(self, count):
        self.random, self.count = np.random.default_rng(0), count

    def reset(self):
        self.angle, self.speed, self.steps = self.random.uniform(-np.pi, np.pi, self.count), self.random.uniform(-1, 1, self.count), 0
        return self.seen()

    def seen(self):
        return np.stack([np.cos(self.angle), np.sin(self.angle), self.speed], axis=1)

    def step(self, actions):
        torque = 2.0 * np.clip(actions[:, 0], -1.0, 1.0)
        wrapped = (self.angle + np.pi) % (2 * np.pi) - np.pi
        rewards = -(wrapped**2 + 0.1 * self.speed**2 + 0.001 * torque**2)
        self.speed = np.clip(self.speed + (15.0 * np.sin(self.angle) + 3.0 * torque) * 0.05, -8.0, 8.0)
        self.angle = self.angle + self.speed * 0.05
        self.steps += 1
        truncated = np.full(self.count, self.steps == 200)
        seen = self.reset() if self.steps == 200 else self.seen()
        return seen, rewards, np.zeros(self.count, bool), truncated, {}


def measured(step, per_step=1):
    """Rate over the seconds of processor time that are given, after a hundred steps."""
    for _ in range(100):
        step()
    steps, start = 0, time.process_time()
    while time.process_time() < start + SECONDS:
        for _ in range(50):
            step()
        steps += 50
    return steps * per_step / (time.process_time() - start)


def pendulum():
    if WHO == "numpy":
        environment, high = Pendulums(COUNT), 1.0
    elif WHO == "regimen":
        import regimen

        environment, high = regimen.make("pendulum") if COUNT == 1 else regimen.make_vec("pendulum", num_envs=COUNT), 1.0
    else:
        make = lambda: gymnasium.make("Pendulum-v1", disable_env_checker=True)
        environment, high = make() if COUNT == 1 else gymnasium.vector.SyncVectorEnv([make] * COUNT), 2.0
    environment.reset()
    if COUNT == 1 and WHO != "numpy":
        action = np.array([0.3 * high], np.float32)

        def step():
            if environment.step(action)[3]:
                environment.reset()
    else:
        actions = np.full((COUNT, 1), 0.3 * high, np.float32)
        step = lambda: environment.step(actions)
    return measured(step, COUNT)


def particles():
    if WHO == "regimen":
        import regimen

        environment, force = regimen.make_parallel("particles", {"variant": "mpe2"}), np.array([0.1, -0.2])
    else:
        from mpe2 import simple_spread_v3

        environment = simple_spread_v3.parallel_env(continuous_actions=True, max_cycles=25)
        force = np.array([0.0, 0.0, 0.1, 0.2, 0.0], np.float32)
    environment.reset(seed=0)
    actions = dict.fromkeys(environment.agents, force)

    def step():
        environment.step(actions)
        if not environment.agents:
            environment.reset()

    return measured(step)


def battery():
    if WHO == "regimen":
        import regimen

        environment = regimen.make_vec("battery", {"cells": 4, "load": {"constant": {"power_w": 32.0}}, "start": "full"}, num_envs=COUNT)
        environment.reset(seed=0)
        shares = np.full((COUNT, 4), 0.25)
        return measured(lambda: environment.step(shares), 40 * COUNT)
    from progpy.models import BatteryElectroChemEOD

    cell = BatteryElectroChemEOD(process_noise=0, measurement_noise=0)
    load = cell.InputContainer({"i": 2.0})
    state, seconds = cell.initialize(), 0

    def step():
        nonlocal state, seconds
        load["i"] = 8.0 / cell.output(state)["v"]
        state, seconds = cell.next_state(state, load, 1.0), seconds + 1
        if seconds == 1000:
            state, seconds = cell.initialize(), 0

    return measured(step)


names = {"regimen": "Regimen from Python", "numpy": f"NumPy {np.__version__} by hand"}
rate = {"pendulum": pendulum, "particles": particles, "battery": battery}[WHAT]()
print(json.dumps({"who": names.get(WHO) or f"{WHO} {importlib.metadata.version(WHO)}", "cell_seconds_per_s" if WHAT == "battery" else "steps_per_s": rate}))
