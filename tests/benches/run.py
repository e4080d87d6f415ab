"""Runs every speed comparison side by side, pair by pair, and prints the ratios as a Markdown table.

Build first: cargo build --release && cargo bench --no-run. Peers: python3 -m venv V && V/bin/pip install -r tests/benches/peers/requirements.txt, and our
Python package: PATH="$PWD/V/bin:$PATH" plugins/wheel/build target/wheels && V/bin/pip install target/wheels/regimen_rl-*.whl
usage: run.py PYTHON_OF_THE_PEERS [ROUNDS] [ONLY...]
"""

import glob
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import programs

PEERS = sys.argv[1]
ROUNDS = int(sys.argv[2]) if len(sys.argv) > 2 else 3
ONLY = sys.argv[3:]
ROOT = str(Path(__file__).resolve().parents[2])
TARGET = os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target"))


def ask(command, env=None):
    output = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env={**os.environ, **(env or {})}, check=True)
    return json.loads(output.stdout.strip().splitlines()[-1])


def bench(name, *words):
    binaries = [path for path in glob.glob(f"{TARGET}/release/deps/{name}-*") if os.access(path, os.X_OK) and "." not in os.path.basename(path)]
    return ask([max(binaries, key=os.path.getmtime), *map(str, words)])


def peer(script, *words, cpu=None):
    command = [PEERS, f"{ROOT}/tests/benches/peers/{script}", *map(str, words)]
    return ask(["taskset", "-c", str(cpu), *command] if cpu is not None else command)


def both(script, words):
    """Two peer processes at the same time, one for each core; the sum of their rates."""
    command = lambda cpu: ["taskset", "-c", str(cpu), PEERS, f"{ROOT}/tests/benches/peers/{script}", *map(str, words)]
    running = [subprocess.Popen(command(cpu), stdout=subprocess.PIPE, text=True) for cpu in (0, 1)]
    answers = [json.loads(process.communicate()[0].strip().splitlines()[-1]) for process in running]
    return {"who": "two processes of " + answers[0]["who"], "updates_per_s": sum(answer["updates_per_s"] for answer in answers)}


def sweep(batch, seconds_of_steps):
    """Updates per second of a study with four seeds on two workers, start and reports included."""
    study = f"""
study: sweep
title: Four seeds
environments: {{ cells: {{ battery: {{ cells: 4 }} }} }}
agents: {{ sac: {{ gaussian_softmax_sac: {{ batch_size: {batch}, critic_layers: 2, policy_layers: 2, updates_per_step: 1.0, learning_starts: 256 }} }} }}
protocol: {{ train_evaluate: {{ steps: {seconds_of_steps}, environments: 1, evaluate_every: 0, final_episodes: 1, trace_episodes: 0 }} }}
seeds: 4
"""
    seconds = timed(study, 2)
    return {"who": "Regimen, 4 seeds on 2 workers", "updates_per_s": 4 * (seconds_of_steps - 256) / seconds}


def overhead(trials):
    study = f"""
study: overhead
title: Trivial trials
environments: {{ task: {{ simplex_reconstruction: {{}} }} }}
agents: {{ equal: {{ equal_split: {{}} }} }}
protocol: {{ train_evaluate: {{ steps: 0, final_episodes: 1, trace_episodes: 0 }} }}
seeds: {trials}
"""
    return {"who": "Regimen, 2 workers", "s_per_trial": timed(study, 2) / trials, "trials": trials}


def trivial_programs(starts):
    seconds = programs.under_regimen(f"{TARGET}/release/regimen", programs.SHELL, starts, 2, TARGET)["s"]
    return {"who": "Regimen, 2 workers", "s_per_trial": seconds / starts, "trials": starts}


def measured(command, folder):
    """Seconds and peak memory of one command."""
    start = time.perf_counter()
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode in (0, 106), command
    return {"s": time.perf_counter() - start, "memory_mb": usage.ru_maxrss / 1e3}


def memory_of_a_run(trials):
    """Peak memory of the scheduling process itself, for trivial trials on two workers."""
    study = f"""
study: memory
environments: {{ task: {{ simplex_reconstruction: {{}} }} }}
agents: {{ equal: {{ equal_split: {{}} }} }}
protocol: {{ train_evaluate: {{ steps: 0, final_episodes: 1, trace_episodes: 0 }} }}
seeds: {trials}
"""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        with open(os.path.join(folder, "study.yaml"), "w") as file:
            file.write(study)
        return measured([f"{TARGET}/release/regimen", "worker", "study.yaml", "-j", "2"], folder)


def scale():
    """How the engine does with many trials and rows."""
    # A study has at most a million trials, and one more seed is tried of each setting.
    for seeds in (100, 999):
        plan = bench("plan", 1000, seeds)
        print(f"\n{plan.pop('trials'):,} trials: " + ", ".join(f"{name.replace('_', ' ')} {seconds:.2f} s and {memory_mb} MB" for name, (seconds, memory_mb) in plan.items()))
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        bench("rows", folder, 1000, 1000)
        ours = measured([f"{TARGET}/release/regimen", "report", "study.yaml"], folder)
        theirs = peer("rows_pandas.py", folder)
    print(f"\n10 million rows in 10,000 trials, table, curve and page: {ours['s']:.2f} s and {ours['memory_mb']:.0f} MB; ", end="")
    print(f"{theirs['who']}, table and curve alone: {theirs['s']:.1f} s and {theirs['memory_mb']:.0f} MB; {theirs['s'] / ours['s']:.1f} times as fast")
    curve = [(trials, memory_of_a_run(trials)) for trials in (1000, 10000, 100000)]
    print("\nPeak memory of the scheduling process: " + ", ".join(f"{trials} trials {one['memory_mb']:.0f} MB ({1e3 * one['s'] / trials:.2f} ms each)" for trials, one in curve))


def timed(study, jobs):
    with tempfile.TemporaryDirectory(dir=TARGET) as folder:
        with open(os.path.join(folder, "study.yaml"), "w") as file:
            file.write(study)
        start = time.perf_counter()
        subprocess.run([f"{TARGET}/release/regimen", "worker", "study.yaml", "-j", str(jobs)], cwd=folder, check=True, capture_output=True)
        return time.perf_counter() - start


def compare(what, key, ours, theirs, higher_is_better):
    if ONLY and not any(word in what for word in ONLY):
        return
    pairs = [(ours(), theirs()) for _ in range(ROUNDS)]
    ratios = [a[key] / b[key] if higher_is_better else b[key] / a[key] for a, b in pairs]
    median = lambda values: statistics.median(values)
    spread = f"{min(ratios):.2f} to {max(ratios):.2f}"
    print(f"| {what} | {pairs[0][1]['who']} | {median([a[key] for a, _ in pairs]):.4g} | {median([b[key] for _, b in pairs]):.4g} | **{median(ratios):.2f}** | {spread} |", flush=True)


print("| what | against | ours | theirs | times as fast | spread |\n|---|---|---|---|---|---|")
for batch, critic, policy in ((256, 2, 2), (1024, 3, 3)):
    what = f"SAC update, batch {batch}, {critic}-layer critics (s)"
    ours = lambda: bench("learning", batch, critic, policy, 5)
    compare(what, "median_s", ours, lambda: peer("sac_torch.py", batch, critic, policy, 5, cpu=0), False)
    compare(what, "median_s", ours, lambda: peer("sac_jax.py", batch, critic, policy, 5, cpu=0), False)
decision = bench("learning", 256, 3, 3, 5, "dirichlet_sac") if not ONLY else None
compare("sweep of 4 seeds on 2 cores (updates/s)", "updates_per_s", lambda: sweep(256, 2256), lambda: both("sac_sb3.py", (256, 2, 2, 10)), True)
compare("battery (cell-seconds/s)", "cell_seconds_per_s", lambda: bench("battery", 3), lambda: peer("battery_progpy.py", 3, cpu=0), True)
for scenario, words in (("cooperative_navigation", "cooperative navigation"), ("predator_prey", "predators and prey")):
    ours = lambda: bench("particles", scenario, 3)
    compare(f"particles, {words} (steps/s)", "steps_per_s", ours, lambda: peer("particles_mpe2.py", scenario, 3, cpu=0), True)
for count in (1, 8):
    for kind in ("sb3", "async"):
        ours = lambda: bench("python_environments", PEERS, "Pendulum-v1", count, 3)
        compare(f"environments in Python, {count} together (steps/s)", "steps_per_s", ours, lambda: peer("python_environments.py", kind, "Pendulum-v1", count, 3), True)
for what, count, key, who in (
    ("pendulum", 1, "steps_per_s", "gymnasium"),
    ("pendulum", 64, "steps_per_s", "gymnasium"),
    ("pendulum", 64, "steps_per_s", "numpy"),
    ("particles", 1, "steps_per_s", "mpe2"),
    ("battery", 16, "cell_seconds_per_s", "progpy"),
):
    ours, theirs = (lambda who=who: peer("python_package.py", who, what, count, 3, cpu=0) for who in ("regimen", who))
    compare(f"{what} stepped from Python, {count} together ({key.replace('_per_s', '/s').replace('_', '-')})", key, ours, theirs, True)
for gas in ("TABULAR", "CEA"):
    compare(f"turbofan, warm point, {gas} (s)", "s_per_point", lambda: bench("turbofan", 3), lambda: peer("turbofan_pycycle.py", 10, gas, cpu=0), False)
compare("trivial trial (s)", "s_per_trial", lambda: overhead(10000), lambda: peer("overhead_optuna.py", 2000), False)
compare("trivial trial (s)", "s_per_trial", lambda: overhead(10000), lambda: peer("overhead_hydra.py", 100), False)
compare("trivial trial (s)", "s_per_trial", lambda: overhead(10000), lambda: peer("overhead_ray.py", 40), False)
for script, starts in (("programs_submitit.py", 100), ("programs_ray.py", 100)):
    compare("trivial program (s)", "s_per_trial", lambda: trivial_programs(1000), lambda: peer(script, starts, *programs.SHELL), False)
for agent in ("tdom_ac", "rommeo", "pr2"):
    compare(f"joint update of {agent} (s)", "median_s", lambda: bench("joint_learning", agent, 5), lambda: peer("joint_torch.py", agent, 5, cpu=0), False)
for name, agent, script in (("CLAC", "clac", "clac_torch.py"), ("QMIX", "value_decomposition", "qmix_torch.py")):
    compare(f"update of {name} (s)", "median_s", lambda: bench("joint_learning", agent, 5), lambda: peer(script, 5, cpu=0), False)
IMAGES = [("convolve_3x3", 16, 16, 16), ("convolve_3x3", 32, 32, 16), ("convolve_3x3", 3, 16, 32), ("convolve_3x3", 16, 3, 32)]
POINTWISE = ("batch", "batch_relu", "instance", "instance_relu", "bilinear", "nearest", "pool", "relu", "tanh", "spectral")
IMAGES += [(name, 32, 32, 16) for name in ("convolve_1x1", "deconvolve_2x2", *POINTWISE)]
for layout in ("first", "last"):
    for name, *sizes in IMAGES:
        what = f"{name} on images, {sizes[0]} to {sizes[1]} channels, {sizes[2]} x {sizes[2]} (s)"
        ours = lambda: bench("images", name, 32, *sizes, 2)
        compare(what, "median_s", ours, lambda: peer("images_torch.py", layout, name, 32, *sizes, 2, cpu=0), False)
    for channels, bottom in ((16, 2), (16, 4), (32, 4)):
        what = f"step of critic and generator, {channels} channels, {8 * bottom} x {8 * bottom} images (s)"
        ours = lambda: bench("adversaries", channels, bottom, 3, 32, 5)
        compare(what, "median_s", ours, lambda: peer("adversaries_torch.py", layout, channels, bottom, 3, 32, 5, cpu=0), False)
if not ONLY or "scale" in ONLY:
    scale()
if decision:
    print(f"\nOne decision of a trained Dirichlet policy (three hidden layers of 256): median {1e6 * decision['decision_median_s']:.0f} us, 99th percentile {1e6 * decision['decision_p99_s']:.0f} us.")
    print(f"One update of Dirichlet SAC, batch 256, three hidden layers: {1e3 * decision['median_s']:.1f} ms.")
