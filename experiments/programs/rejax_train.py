"""Trains an agent of rejax, by the few lines of its tour, and prints the episodes of every evaluation as JSON.

usage: rejax_train.py SETTINGS TASK SEED STEPS EVERY, where SETTINGS is a JSON file: `algorithm`, and what its `create` takes
"""

import json
import sys

import jax
from rejax import get_algo

path, task, seed, steps, every = *sys.argv[1:3], *map(int, sys.argv[3:])
with open(path, encoding="utf-8") as file:
    settings = json.load(file)
# The function of the network is a setting of the agent within.
settings["agent_kwargs"] = {"activation": settings.pop("activation")}
algorithm = get_algo(settings.pop("algorithm")).create(env=task, total_timesteps=steps, eval_freq=every, **settings)
_, (lengths, returns) = jax.jit(algorithm.train)(jax.random.PRNGKey(seed))
for evaluation, (length, earned) in enumerate(zip(lengths, returns, strict=True)):
    print(json.dumps({"step": evaluation * every, "return": float(earned.mean()), "length": float(length.mean())}))
