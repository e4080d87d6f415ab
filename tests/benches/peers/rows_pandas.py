"""Seconds and peak memory of pandas for the table and the curve of a store. Prints them as JSON. usage: rows_pandas.py FOLDER"""

import glob
import json
import resource
import sys
import time

start = time.perf_counter()
import pandas

frames = []
for path in glob.glob(f"{sys.argv[1]}/store/trials/*/*/metrics.parquet"):
    with open(path.replace("metrics.parquet", "trial.json")) as file:
        key = json.load(file)["key"]
    frame = pandas.read_parquet(path, columns=["phase", "step", "metric", "value"])
    frame["agent"] = json.dumps(key["agent"]["config"])
    frame["seed"] = key["seed"]
    frames.append(frame)
rows = pandas.concat(frames)
table = rows[rows.phase == "final"].groupby(["agent", "seed"]).value.mean().groupby("agent").agg(["mean", "std", "count"])
by_seed = rows[rows.phase == "evaluate"].groupby(["agent", "seed", "step"]).value.mean()
curve = by_seed.groupby(["agent", "step"]).agg(["mean", "std"])
seconds = time.perf_counter() - start
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
print(json.dumps({"who": f"pandas {pandas.__version__}", "s": seconds, "memory_mb": memory, "rows": len(rows), "points": len(table) + len(curve)}))
