"""The walk of `walk.sh` in Python, with the same words. Each step waits in a process of its own."""

import json
import os
import signal
import subprocess
import sys

import regimen_trial

name, rate, seed, steps, every, says, at_sigterm, checkpoint = sys.argv[1:9]
rate, seed, steps, every = int(rate), int(seed), int(steps), int(every)
state, leaving, trial = f"{checkpoint}/state", [], regimen_trial.trial()


def note(what, step):
    with open(f"{os.environ['KILLS_NOTES']}/{name}-{seed}", "a") as notes:
        notes.write(f"{what} {step}\n")


def save(step, x):
    note("saving", step)
    with open(f"{checkpoint}/new", "w") as file:
        file.write(f"{step} {x}")
    os.replace(f"{checkpoint}/new", state)
    note("saved", step)


def say(step, value):
    if says == "stdout":
        print(json.dumps({"step": step, "value": value}), flush=True)
    elif says == "log":
        trial.log(step=step, value=value)
    else:
        with open("curve.csv", "a") as curve:
            curve.write(f"{step},{value}\n")


def begun():
    if sys.argv[9:] != ["--resume"]:
        return 0, seed
    with open(state) as file:
        return tuple(map(int, file.read().split()))


if at_sigterm == "saves":
    signal.signal(signal.SIGTERM, lambda *_: leaving.append(True))
if says == "csv" and not os.path.exists("curve.csv"):
    with open("curve.csv", "w") as curve:
        curve.write("step,value\n")
step, x = begun()
note("begins", step)
while step < steps:
    subprocess.run(["sleep", "0.25"])
    step, x = step + 1, (x * 1103515245 + 12345) % 2147483648
    note("computes", step)
    say(step, step * rate + x % 1000)
    if step % every == 0 or leaving:
        save(step, x)
    if leaving:
        sys.exit()
note("ends", step)
