"""Seconds per trivial trial of Ray Tune on two cores. Prints it as JSON. usage: overhead_ray.py TRIALS"""

import json
import logging
import os
import sys
import tempfile
import time

os.environ.update(RAY_AIR_NEW_OUTPUT="0", TUNE_DISABLE_AUTO_CALLBACK_LOGGERS="0", RAY_DEDUP_LOGS="0", TUNE_MAX_PENDING_TRIALS_PG="2")

import ray
from ray import tune

trials = int(sys.argv[1])
ray.init(num_cpus=2, include_dashboard=False, logging_level=logging.ERROR, log_to_driver=False)
with tempfile.TemporaryDirectory() as folder:
    tuner = tune.Tuner(
        lambda config: {"x": config["x"]},
        param_space={"x": tune.uniform(0, 1)},
        tune_config=tune.TuneConfig(num_samples=trials, reuse_actors=True),
        run_config=tune.RunConfig(storage_path=folder, name="overhead", verbose=0),
    )
    start = time.perf_counter()
    tuner.fit()
    seconds = (time.perf_counter() - start) / trials
print(json.dumps({"who": f"Ray Tune {ray.__version__}", "s_per_trial": seconds, "trials": trials}))
