"""Seconds per trivial trial of Optuna with its journal file, one process. Prints it as JSON. usage: overhead_optuna.py TRIALS"""

import json
import os
import sys
import tempfile
import time

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend

optuna.logging.set_verbosity(optuna.logging.ERROR)
trials = int(sys.argv[1])
with tempfile.TemporaryDirectory() as folder:
    storage = JournalStorage(JournalFileBackend(os.path.join(folder, "journal.log")))
    study = optuna.create_study(storage=storage, sampler=optuna.samplers.RandomSampler(seed=0))
    start = time.perf_counter()
    study.optimize(lambda trial: trial.suggest_float("x", 0, 1), n_trials=trials)
    seconds = (time.perf_counter() - start) / trials
print(json.dumps({"who": f"Optuna {optuna.__version__} journal file", "s_per_trial": seconds, "trials": trials}))
