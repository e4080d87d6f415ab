"""Plays again what `regimen rollout` wrote, and compares rewards, ends and traces bit by bit. usage: wheel_rollouts.py FOLDER"""

import csv
import os
import sys

import numpy as np
import regimen

CELLS = {"cells": 3, "decision_interval_s": 20}


def rows(name):
    with open(os.path.join(sys.argv[1], name)) as file:
        return [row for row in csv.DictReader(file) if row["decision"] != "0"]


def number(text):
    return float(text) if text else np.nan


def follow(environment, name, start):
    """Steps as the file says, and counts the decisions."""
    environment.reset(**start)
    names = environment.seat["observation"]["names"]
    decisions = rows(name)
    for row in decisions:
        action = np.array([number(row[share]) for share in environment.seat["action"]["names"]])
        seen, reward, terminated, truncated, _ = environment.step(action)
        assert reward == number(row["reward"]), (name, row["decision"], reward, row["reward"])
        assert ("terminated" if terminated else "truncated" if truncated else "") == row["end"], (name, row)
        traced = [entry for entry in names if entry in row]
        assert traced and all(seen[names.index(entry)] == number(row[entry]) for entry in traced), (name, row["decision"])
    return len(decisions), terminated or truncated


battery = regimen.make("battery", CELLS)
assert follow(battery, "rollout.csv", {"seed": 11}) == (12, False)
for episode in (2, 0, 2):
    length, ended = follow(battery, f"episode-{episode}.csv", {"seed": 4, "options": {"episode": episode}})
    assert ended and length > 1, (episode, length)
# Without a seed it is that of before.
battery.reset(seed=4)
again = battery.reset(options={"episode": 2})[0]
assert np.array_equal(again, battery.reset(seed=4, options={"episode": 2})[0])
assert not np.array_equal(again, battery.reset(seed=4, options={"episode": 0})[0])

# Vectors take an episode for all, or one for each.
vector = regimen.make_vec("battery", CELLS, num_envs=3)
seen, _ = vector.reset(seed=[4, 4, 4], options={"episode": [0, 1, 2]})
assert np.array_equal(seen[2], again) and not np.array_equal(seen[1], again)
assert np.array_equal(vector.reset(seed=[4] * 3, options={"episode": 2})[0], np.array([again] * 3))

agents = regimen.make_parallel("particles")
agents.reset(seed=11)
for row in rows("particles.csv"):
    forces = {agent: np.array([number(row[f"{agent}.force_{axis}"]) for axis in "xy"]) for agent in agents.agents}
    seen, rewards, *_ = agents.step(forces)
    for agent, reward in rewards.items():
        assert reward == number(row[f"{agent}.reward"]), row["decision"]
        assert seen[agent].tolist() == [number(row[f"{agent}.obs_{entry}"]) for entry in range(len(seen[agent]))]
