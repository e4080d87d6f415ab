"""The cost of a trial of a program over the bare command: the same command many times under `regimen run` and by xargs, pair by pair.

Prints a Markdown table: milliseconds from the start of all to the end of all, per trial, and the processor time of everything that was
started. Our side counts from the start of `regimen run` to its report, with its store on the disk of FOLDER.

usage: programs.py [REGIMEN] [TRIALS] [ROUNDS] [FOLDER]
"""

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time

SHELL = ["sh", "-c", "echo r=1"]
PYTHON = [sys.executable, "-c", "print('r=1')"]


def study(command, trials):
    program = {"run": command, "lock": "none", "metrics": {"r": "r"}}
    return {
        "study": "programs",
        "environments": {"task": {"named": {"id": "none"}}},
        "agents": {"mine": {"program": program}},
        "protocol": {"train_evaluate": {"steps": 0, "evaluate_every": 0}},
        "seeds": trials,
    }


def timed(command, **more):
    """Seconds of a command, and the processor time of all that it started and waited for."""
    used = lambda: sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
    start, before = time.perf_counter(), used()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **more)
    return {"s": time.perf_counter() - start, "processor_s": used() - before}


def under_regimen(regimen, command, trials, jobs, within):
    """Seconds of a study of so many trials, each of which starts a command."""
    with tempfile.TemporaryDirectory(dir=within) as folder:
        # JSON is YAML.
        with open(os.path.join(folder, "study.yaml"), "w") as file:
            json.dump(study(command, trials), file)
        return timed([regimen, "run", "study.yaml", "-j", str(jobs), "--yes"], cwd=folder)


def bare(command, trials, jobs):
    """Seconds of a command so many times, `jobs` of them at a time."""
    numbers = "\n".join(map(str, range(trials)))
    return timed(["xargs", "-n", "1", "-P", str(jobs), *command], input=numbers.encode())


def row(what, regimen, command, trials, jobs, rounds, within):
    pairs = [(under_regimen(regimen, command, trials, jobs, within), bare(command, trials, jobs)) for _ in range(rounds)]
    over = {key: [1e3 * (ours[key] - theirs[key]) / trials for ours, theirs in pairs] for key in ("s", "processor_s")}
    median = lambda side, key="s": 1e3 * statistics.median(pair[side][key] for pair in pairs) / trials
    spread = f"{min(over['s']):.1f} to {max(over['s']):.1f}"
    processor = statistics.median(over["processor_s"])
    print(f"| {what} | {jobs} | {median(0):.1f} | {median(1):.1f} | **{statistics.median(over['s']):.1f}** | {spread} | {processor:.1f} |", flush=True)


def main():
    regimen = sys.argv[1] if len(sys.argv) > 1 else "regimen"
    trials, rounds = (int(word) for word in (sys.argv[2:4] + ["200", "3"][len(sys.argv[2:4]) :]))
    within = sys.argv[4] if len(sys.argv) > 4 else None
    print("| program | at a time | ours, ms a trial | bare, ms | over it, ms | spread | processor time over it, ms |\n|---|---|---|---|---|---|---|")
    for what, command in (("`sh` that prints a number", SHELL), ("Python that prints a number", PYTHON)):
        for jobs in (1, 2):
            row(what, regimen, command, trials, jobs, rounds, within)


if __name__ == "__main__":
    main()
