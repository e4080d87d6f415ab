"""Seconds per trivial trial of a Hydra multirun with the joblib launcher, two jobs. Prints it as JSON. usage: overhead_hydra.py TRIALS"""

import importlib.metadata
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

APPLICATION = """
import hydra


@hydra.main(version_base=None, config_name=None)
def main(config):
    return 1.0


main()
"""
trials = int(sys.argv[1])
with tempfile.TemporaryDirectory() as folder:
    Path(folder, "application.py").write_text(APPLICATION)
    command = [sys.executable, "application.py", "-m", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", f"+x=range({trials})"]
    start = time.perf_counter()
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    seconds = (time.perf_counter() - start) / trials
print(json.dumps({"who": f"Hydra {importlib.metadata.version('hydra-core')} joblib", "s_per_trial": seconds, "trials": trials}))
