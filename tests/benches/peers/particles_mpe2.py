"""Steps per second of mpe2's parallel environment, one thread, episodes of 25 steps of one joint action. Prints the rate as JSON.

usage: particles_mpe2.py SCENARIO SECONDS
"""

import importlib.metadata
import json
import sys
import time

import numpy as np
from mpe2 import simple_spread_v3, simple_tag_v3

scenario = {"cooperative_navigation": simple_spread_v3, "predator_prey": simple_tag_v3}[sys.argv[1]]
environment = scenario.parallel_env(continuous_actions=True, max_cycles=25)
environment.reset(seed=0)
actions = {agent: np.array([0.0, 0.0, 0.1, 0.2, 0.0], dtype=np.float32) for agent in environment.agents}
steps, start = 0, time.perf_counter()
while time.perf_counter() < start + int(sys.argv[2]):
    environment.reset()
    while environment.agents:
        environment.step(actions)
        steps += 1
rate = steps / (time.perf_counter() - start)
print(json.dumps({"who": f"mpe2 {importlib.metadata.version('mpe2')}", "steps_per_s": rate}))
