"""Seconds for each of many starts of a command by trials of Ray Tune on two cores. Prints JSON. usage: programs_ray.py STARTS WORD..."""

import json
import logging
import os
import subprocess
import sys
import tempfile
import time

os.environ.update(RAY_AIR_NEW_OUTPUT="0", TUNE_DISABLE_AUTO_CALLBACK_LOGGERS="0", RAY_DEDUP_LOGS="0", TUNE_MAX_PENDING_TRIALS_PG="2")

import ray
from ray import tune

starts, command = int(sys.argv[1]), sys.argv[2:]


def started(config):
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return {"r": float(output.strip().removeprefix("r="))}


ray.init(num_cpus=2, include_dashboard=False, logging_level=logging.ERROR, log_to_driver=False)
with tempfile.TemporaryDirectory() as folder:
    tuner = tune.Tuner(
        started,
        param_space={"seed": tune.uniform(0, 1)},
        tune_config=tune.TuneConfig(num_samples=starts, reuse_actors=True),
        run_config=tune.RunConfig(storage_path=folder, name="programs", verbose=0),
    )
    start = time.perf_counter()
    results = tuner.fit()
    seconds = (time.perf_counter() - start) / starts
    assert all(result.metrics["r"] == 1 for result in results)
print(json.dumps({"who": f"Ray Tune {ray.__version__}", "s_per_trial": seconds, "trials": starts}))
