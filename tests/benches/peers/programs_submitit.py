"""Seconds for each of many starts of a command under Submitit's local executor, two at a time. Prints JSON. usage: programs_submitit.py STARTS WORD..."""

import importlib.metadata
import json
import sys
import tempfile
import time

import submitit

starts, command = int(sys.argv[1]), sys.argv[2:]
with tempfile.TemporaryDirectory() as folder:
    executor = submitit.LocalExecutor(folder)
    start = time.perf_counter()
    left, running = starts, []
    # It starts whatever it is given at once: two at a time is up to who submits.
    while left or running:
        while left and len(running) < 2:
            running.append(executor.submit(submitit.helpers.CommandFunction(command, verbose=False)))
            left -= 1
        time.sleep(0.002)
        done = [job for job in running if job.done()]
        assert all("r=1" in job.result() for job in done)
        running = [job for job in running if job not in done]
    seconds = (time.perf_counter() - start) / starts
print(json.dumps({"who": f"Submitit {importlib.metadata.version('submitit')}, local", "s_per_trial": seconds, "trials": starts}))
