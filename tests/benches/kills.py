"""Kills a study of eight programs at random moments until it is done, and holds it against the same study let alone.

These hold: every recorded value and every verdict is that of the undisturbed run; a step is computed a second time only where it came
after the program's last checkpoint; no trial that had ended starts again. The programs (`kills/walk.sh`, `kills/walk.py`) note outside of their
trials what they begin, compute and save. Prints what was counted, and leaves with 1 where something does not hold. Needs Linux.

usage: kills.py [REGIMEN] [KILLS] [SEED] [KIND...], with the kinds of `KINDS` in turns where none is named, or `stalled`: a worker alone that was
suspended for a second before, as on a machine that has no time for it.
"""

import collections
import csv
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

REGIMEN = sys.argv[1] if len(sys.argv) > 1 else "regimen"
KILLS = int(sys.argv[2]) if len(sys.argv) > 2 else 20
SEED = int(sys.argv[3]) if len(sys.argv) > 3 else 1
STUDY = str(Path(__file__).resolve().parent / "kills" / "study.yaml")
STEPS, TRIALS = 12, 24
# Who is killed: the process group of the run, all its processes with guards and programs, the scheduler alone, or one worker alone.
KINDS = sys.argv[4:] or ["group", "group", "everything", "scheduler", "worker"]
# Seconds from one kill, and the new start, to the next kill: short ones strike the start.
PAUSE = (0.1, 2.6)
# Columns that say when and how fast, and not what.
OF_THE_CLOCK = {"wall_time", "time_per_decision", "ended_at"}


def start(place):
    """A run of the study whose store, results and notes lie in a folder, in a process group of its own."""
    notes = place / "notes"
    notes.mkdir(parents=True, exist_ok=True)
    words = ["run", STUDY, "--store", place / "store", "--out", place / "results", "-j", "2", "--retries", "100", "--yes", "--no-rehearsal"]
    with open(place / "said", "a") as said:
        return subprocess.Popen([REGIMEN, *words], stdout=said, stderr=said, start_new_session=True, env={**os.environ, "KILLS_NOTES": str(notes)})


def processes_below(ancestor):
    """Process ids and command lines of all that a process started and that still has parents up to it."""
    children = collections.defaultdict(list)
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = (folder / "stat").read_text().rpartition(")")[2].split()[1]
            children[int(parent)].append((int(folder.name), (folder / "cmdline").read_text()))
        except OSError:
            continue
    found = list(children[ancestor])
    for process, _ in found:
        found.extend(children[process])
    return found


def workers(scheduler):
    until = time.monotonic() + 10
    while time.monotonic() < until:
        if found := [process for process, words in processes_below(scheduler) if "trial-worker" in words]:
            return found
        time.sleep(0.01)
    raise SystemExit("the run started no worker within 10 s")


def strike(kind, scheduler, dice):
    """Kills; true where the run is to be started anew."""
    is_worker = kind in ("worker", "stalled")
    if is_worker:
        struck = [dice.choice(workers(scheduler.pid))]
    elif kind == "everything":
        struck = [scheduler.pid, *(process for process, _ in processes_below(scheduler.pid))]
    else:
        struck = [scheduler.pid]
    if kind == "stalled":
        os.kill(struck[0], signal.SIGSTOP)
        time.sleep(1)
    for process in struck:
        try:
            (os.killpg if kind == "group" else os.kill)(process, signal.SIGKILL)
        except ProcessLookupError:
            pass
    if not is_worker:
        scheduler.wait()
    return not is_worker


def notes_of(place):
    """The notes of each trial, as pairs of a word and a step."""
    lines = {file.name: file.read_text().splitlines() for file in (place / "notes").iterdir()}
    return {trial: [(what, int(step)) for what, step in map(str.split, noted)] for trial, noted in lines.items()}


def begins(noted):
    return sum(what == "begins" for what, _ in noted)


def ended(place):
    """The trials that the store has acknowledged as `ok`, with how often each had begun."""
    found = [json.loads(file.read_text()) for file in (place / "store").glob("trials/*/*/trial.json")]
    noted = notes_of(place)
    names = [f"{trial['key']['agent']['config']['run'][2]}-{trial['key']['seed']}" for trial in found if trial["end"]["state"] == "ok"]
    return {name: begins(noted[name]) for name in names}


def killed_until_done(place):
    """How often each kind of kill struck, and which trials had ended before one of them."""
    dice, struck, before = random.Random(SEED), collections.Counter(), {}
    kinds = [KINDS[at % len(KINDS)] for at in range(KILLS)]
    dice.shuffle(kinds)
    scheduler = start(place)
    for kind in kinds:
        time.sleep(dice.uniform(*PAUSE))
        if scheduler.poll() is not None:
            break
        before = {**ended(place), **before}
        struck[kind] += 1
        if strike(kind, scheduler, dice):
            scheduler = start(place)
    return struck, before, scheduler.wait()


def recorded(place):
    """Every row of the tidy tables without what the clock says, and the verdicts without times."""
    subprocess.run([REGIMEN, "export", STUDY, "--store", place / "store", "--as", "csv", "--to", place / "csv"], check=True, capture_output=True)
    rows = {}
    for table in ("evaluations", "training", "trials"):
        with open(place / "csv" / f"{table}.csv", newline="") as file:
            rows[table] = {named(row): {key: value for key, value in row.items() if key not in OF_THE_CLOCK} for row in csv.DictReader(file)}
    judged = without_times(json.loads((place / "results" / "verdicts.json").read_text()))
    return rows, [{key: value for key, value in judged.items() if key != "verdicts"}, *judged["verdicts"]]


def named(row):
    return " ".join(row[key] for key in ("agent", "seed", "phase", "step", "metric") if key in row)


def without_times(value):
    if isinstance(value, dict):
        return {key: without_times(inner) for key, inner in value.items() if key != "trial_time_s"}
    return [without_times(inner) for inner in value] if isinstance(value, list) else value


def replay(trial, noted):
    """Follows the notes of a trial: how many steps were computed, how many of them again, and what must not be."""
    faults, computed, again, at, saving, saved = [], set(), 0, 0, 0, 0
    for what, step in noted:
        if what == "begins":
            # A checkpoint may lie there whose program was killed before it could note so.
            if step not in (saved, saving):
                faults.append(f"{trial} begins at {step}, and its last checkpoint is of step {saved}")
            at = saved = step
        elif what == "computes":
            if step != at + 1:
                faults.append(f"{trial} computes step {step} after step {at}: two of it ran at once")
            if step in computed and step <= saved:
                faults.append(f"{trial} computes step {step} again, and its last checkpoint is of step {saved}")
            again += step in computed
            computed.add(step)
            at = step
        elif what == "saving":
            saving = step
        elif what == "saved":
            saved = step
    if computed != set(range(1, STEPS + 1)) or noted[-1] != ("ends", STEPS):
        faults.append(f"{trial} computed {sorted(computed)} and noted {noted[-1]} last")
    return len(computed), again, faults


def counted(place):
    noted = notes_of(place)
    replays = [replay(trial, noted[trial]) for trial in sorted(noted)]
    faults = [fault for *_, found in replays for fault in found]
    if len(noted) != TRIALS:
        faults.append(f"{len(noted)} of {TRIALS} trials began")
    starts = sum(map(begins, noted.values()))
    return {"starts": starts, "steps": sum(steps for steps, *_ in replays), "again": sum(again for _, again, _ in replays)}, faults


def differences(ours, theirs):
    (rows, verdicts), (other_rows, other_verdicts) = ours, theirs
    for table in rows:
        if missing := rows[table].keys() ^ other_rows[table].keys():
            yield f"{table}: only one of the two has {sorted(missing)}"
        for name in sorted(rows[table].keys() & other_rows[table].keys()):
            one, other = rows[table][name], other_rows[table][name]
            differing = {key: (one.get(key), other.get(key)) for key in one.keys() | other.keys() if one.get(key) != other.get(key)}
            if differing:
                yield f"{table}, {name}: killed and undisturbed differ in {differing}"
    for one, other in zip(verdicts, other_verdicts):
        if one != other:
            yield f"verdicts: killed {one}, undisturbed {other}"


def compare(folder):
    killed, alone = folder / "killed", folder / "alone"
    for place in (killed, alone):
        place.mkdir()
    struck, before, code = killed_until_done(killed)
    codes = {"the killed run": code, "the undisturbed run": start(alone).wait()}
    faults = [f"{which} left with {code}" for which, code in codes.items() if code]
    if struck.total() < KILLS:
        faults.append(f"the study was done after {struck.total()} of {KILLS} kills")
    if faults:
        return faults + [(killed / "said").read_text()[-2000:]]
    counts, faults = counted(killed)
    undisturbed, more = counted(alone)
    faults += more
    if undisturbed["again"] or undisturbed["starts"] != TRIALS:
        faults.append(f"undisturbed, it came to {undisturbed}")
    noted = notes_of(killed)
    anew = [trial for trial, times in before.items() if begins(noted[trial]) != times]
    faults += [f"{trial} had ended and began again" for trial in anew]
    ours, theirs = recorded(killed), recorded(alone)
    faults += differences(ours, theirs)
    print(f"{struck.total()} kills: " + ", ".join(f"{kind} {times}" for kind, times in sorted(struck.items())))
    print(f"{TRIALS} trials of 8 programs: {counts['starts']} starts; {len(before)} trials had ended before a kill, {len(anew)} of them began again")
    print(f"{counts['steps']} steps, {counts['again']} of them computed again")
    print(f"{sum(map(len, ours[0].values()))} recorded rows and {len(ours[1]) - 1} verdicts held against the undisturbed run")
    return faults


def main():
    with tempfile.TemporaryDirectory() as folder:
        faults = compare(Path(folder))
    for fault in faults:
        print(f"DOES NOT HOLD: {fault}")
    if not faults:
        print("All of it holds.")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
