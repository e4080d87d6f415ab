"""Logs as training programs leave them, with the values that pandas and TensorBoard's own reader find in them.

`imported_logs.py FOLDER` writes 200 logs into the folder, always the same ones, and `cases.json`: of each log its files, the
options of `regimen import`, and the curves of every run, or null where the log is to be refused.
"""

import gzip
import json
import math
import os
import random
import sys

import pandas
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter
from tensorboard.util import tensor_util

RETURN = ["--metric", "return=return"]


def steps_and_values(chance, first=0, count=None):
    """Steps that grow, at gaps of any length, each with a value."""
    step, found = first, []
    for _ in range(count or chance.randint(3, 30)):
        found.append((step, chance.uniform(-1e3, 1e3) * 10.0 ** chance.randint(-6, 6)))
        step += chance.choice([1, 7, 64, 1000])
    return found


def frame(points, name="return"):
    return pandas.DataFrame(points, columns=["step", name])


def points_of(table, name="return", step="step"):
    """What pandas has of a curve: cells that are empty are passed over, and steps are in order."""
    table = table[[step, name]].dropna().sort_values(step, kind="stable")
    return [[int(at), float(value)] for at, value in table.itertuples(index=False)]


def read(path, **options):
    return pandas.read_csv(path, **options)


# Tables: each function writes files into a folder and gives the files, the options and the curves of every run.


def plain(chance, folder):
    table = frame(steps_and_values(chance))
    table["loss"] = [chance.random() if chance.random() < 0.5 else None for _ in range(len(table))]
    table["return"] = [None if at and chance.random() < 0.3 else value for at, value in enumerate(table["return"])]
    path = f"{folder}/progress.csv"
    table.to_csv(path, index=chance.random() < 0.5)
    return [path], RETURN, [points_of(read(path))]


def not_finite(chance, folder):
    path = f"{folder}/progress.csv"
    table = frame(steps_and_values(chance))
    table.loc[chance.sample(range(1, len(table)), k=1), "return"] = math.nan
    table.to_csv(path, index=False, na_rep=chance.choice(["nan", "NaN"]))
    if chance.random() < 0.3:
        return [path], RETURN, None
    return [path], RETURN + ["--leave-out", "not_finite"], [points_of(read(path))]


def restarted(chance, folder):
    before, again = steps_and_values(chance, count=9), steps_and_values(chance, count=7)
    first = before[chance.randint(1, 5)][0]
    after = [(step + first, value) for step, value in again]
    path = f"{folder}/progress.csv"
    frame(before + after).to_csv(path, index=False)
    table = read(path)
    how = chance.choice([None, "resume", "new_run"])
    begin = int((table["step"].diff() < 0).idxmax())
    old, new = table[:begin], table[begin:]
    if how is None:
        return [path], RETURN, None
    if how == "resume":
        kept = old[old["step"] < new["step"].iloc[0]]
        return [path], RETURN + ["--restart", how], [points_of(pandas.concat([kept, new]))]
    return [path], RETURN + ["--restart", how], [points_of(old), points_of(new)]


def two_runs(chance, folder):
    lines = [(name, *point) for name in "ab" for point in steps_and_values(chance, count=6)]
    chance.shuffle(lines) if chance.random() < 0.3 else lines.sort(key=lambda line: line[1])
    is_sorted = all(one[1] <= other[1] for one, other in zip(lines, lines[1:]))
    path = f"{folder}/long.csv"
    pandas.DataFrame(lines, columns=["name", "step", "return"]).to_csv(path, index=False)
    table = read(path)
    if not is_sorted or chance.random() < 0.3:
        return [path], RETURN + (["--run", "name"] if not is_sorted and mixed(table) else []), None
    runs = [points_of(table[table["name"] == name]) for name in table["name"].unique()]
    return [path], RETURN + ["--run", "name"], runs


def mixed(table):
    """Whether the steps of one of the runs go back."""
    return any((table[table["name"] == name]["step"].diff() < 0).any() for name in "ab")


def several_files(chance, folder):
    paths, first = [], 0
    for place in range(3):
        points = steps_and_values(chance, first, 5)
        first = points[-1][0] + chance.randint(1, 9)
        table = frame(points)
        table["seed"] = 7
        paths.append(f"{folder}/part-{(place + 2) % 3}.csv")
        table.to_csv(paths[-1], index=False)
    whole = pandas.concat([read(path) for path in paths])
    return paths, RETURN + ["--seed", "seed"], [points_of(whole)]


def same_step(chance, folder):
    points = [point for step, value in steps_and_values(chance, count=6) for point in [(step, value), (step, -value)]]
    path = f"{folder}/progress.csv"
    frame(points).to_csv(path, index=False)
    how = chance.choice([None, "mean", "last"])
    if how is None:
        return [path], RETURN, None
    table = read(path)
    table = table.groupby("step", as_index=False).last() if how == "last" else table
    return [path], RETURN + ["--same-step", how], [points_of(table)]


def separated(chance, folder):
    separator, decimal = chance.choice([(";", ","), (";", "."), ("\t", "."), ("\t", ","), ("|", ".")])
    table = frame([(step, round(value, 2) + 0.25) for step, value in steps_and_values(chance)])
    path = f"{folder}/log.txt"
    table.to_csv(path, index=False, sep=separator, decimal=decimal, float_format="%.5f")
    return [path], RETURN, [points_of(read(path, sep=separator, decimal=decimal))]


def packed(chance, folder):
    path = f"{folder}/log.csv.gz"
    with gzip.open(path, "wt") as file:
        frame(steps_and_values(chance)).to_csv(file, index=False)
    return [path], RETURN, [points_of(read(path))]


def parquet(chance, folder):
    path = f"{folder}/log.parquet"
    table = frame(steps_and_values(chance))
    table["return"] = [None if at and chance.random() < 0.2 else value for at, value in enumerate(table["return"])]
    table = table.astype({"step": chance.choice(["int64", "int32", "float64"]), "return": chance.choice(["float64", "float32"])})
    table["who"] = "a"
    table.to_parquet(path)
    return [path], RETURN, [points_of(pandas.read_parquet(path))]


def json_lines(chance, folder):
    path = f"{folder}/result.json"
    points = steps_and_values(chance)
    with open(path, "w") as file:
        for step, value in points:
            print(json.dumps({"step": step, "info": {"return": value, "loss": math.nan}}), file=file)
    table = pandas.json_normalize([json.loads(line) for line in open(path)])
    return [path], ["--metric", "return=info/return"], [points_of(table, "info.return")]


def json_document(chance, folder):
    orient = chance.choice(["columns", "records", "split", "list"])
    path, table = f"{folder}/log.json", frame(steps_and_values(chance))
    if orient == "list":
        json.dump(table.to_dict(orient="list"), open(path, "w"))
    else:
        table.to_json(path, orient=orient, double_precision=15)
    if orient == "list":
        found = pandas.DataFrame(json.load(open(path)))
    else:
        found = pandas.read_json(path, orient=orient, precise_float=True)
    return [path], RETURN, [points_of(found)]


def monitor(chance, folder):
    path = f"{folder}/monitor.csv"
    with open(path, "w") as file:
        file.write('#{"t_start": 1700000000.5, "env_id": "Walker-v4"}\nr,l,t\n')
        for at in range(chance.randint(2, 30)):
            file.write(f"{chance.uniform(-9, 9):.6f},{chance.randint(1, 999)},{at}.25\n")
    table = read(path, comment="#")
    table["step"] = table["l"].cumsum()
    if chance.random() < 0.3:
        return [path], ["--metric", "return=r", "--step", "l"], None
    return [path], ["--metric", "return=r", "--step-sum", "l"], [points_of(table, "r")]


def wide(chance, folder):
    path = f"{folder}/wandb_export.csv"
    table = pandas.DataFrame({"Step": [step for step, _ in steps_and_values(chance)]})
    for run in "abc":
        values = [chance.uniform(-9, 9) if not at or chance.random() < 0.6 else None for at in range(len(table))]
        for end in ["", "__MIN", "__MAX"]:
            table[f"{run} - eval/return{end}"] = values
    table.to_csv(path, index=False)
    table = read(path)
    runs = [points_of(table, f"{run} - eval/return", "Step") for run in "abc"]
    return [path], ["--step", "Step", "--metric", "return=* - eval/return"], runs


def odd_names(chance, folder):
    name = chance.choice(['a,"b"', "a b ü", "a;b", "train/loss: 1e-3", "100%", "a\tb", "=x"])
    path = f"{folder}/odd.csv"
    frame(steps_and_values(chance), name).to_csv(path, index=False)
    return [path], ["--metric", f"return={name}"], [points_of(read(path), name)]


# Event files.


def write(path, version, events):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "wb") as file:
        records = RecordWriter(file)
        first = [Event(wall_time=1.0, file_version=version)] if version else []
        for event in first + events:
            records.write(event.SerializeToString())


def scalar(tag, step, value, as_tensor=False):
    value = (
        Summary.Value(tag=tag, tensor=tensor_util.make_tensor_proto(value, dtype="float32"))
        if as_tensor
        else Summary.Value(tag=tag, simple_value=value)
    )
    return Event(wall_time=2.0, step=step, summary=Summary(value=[value]))


def seen(folder, tag):
    """What TensorBoard has of a tag: values that are not a number are passed over, as the option says."""
    log = EventAccumulator(folder, size_guidance={"scalars": 0, "tensors": 0})
    log.Reload()
    if tag in log.Tags()["scalars"]:
        points = [(event.step, event.value) for event in log.Scalars(tag)]
    else:
        points = [(event.step, tensor_util.make_ndarray(event.tensor_proto).item()) for event in log.Tensors(tag)]
    return [[step, value] for step, value in points if not math.isnan(value)]


def events(chance, folder):
    tag = chance.choice(["charts/episodic_return", 'odd "tag", ü', "a*b", "rollout/ep rew mean", "#1"])
    version = chance.choice(["brain.Event:2", "brain.Event:2", "brain.Event:1", None])
    files, first, last = [], 0, 0
    restarts = chance.choice([[], [], ["goes on"], ["goes on", "goes on"], ["start"], ["start", "start"], ["silent"]])
    # This reader purges older forms of scalars alone, and TensorBoard's page all.
    as_tensor = chance.random() < 0.4 and not {"start", "silent"} & set(restarts)
    for place, how in enumerate(["begin", *restarts]):
        log = []
        if how == "goes on":
            first = last + chance.randint(1, 50)
        elif how in ["start", "silent"]:
            first = last // 2
        if how == "start":
            log.append(Event(wall_time=2.0, step=first, session_log=SessionLog(status=SessionLog.START)))
        for step, value in steps_and_values(chance, first, chance.randint(4, 12)):
            value = math.nan if step and chance.random() < 0.1 else value
            log.append(scalar(tag, step, value, as_tensor))
            if chance.random() < 0.3:
                log.append(scalar(tag, step, value + 1.0, as_tensor))
            if chance.random() < 0.5:
                log.append(scalar("loss", step, chance.random()))
            last = step
        files.append(f"{folder}/run/events.out.tfevents.170000000{place}.host")
        write(files[-1], version, log)
    if chance.random() < 0.2:
        with open(files[-1], "r+b") as file:
            file.truncate(os.path.getsize(files[-1]) - chance.randint(1, 15))
    curve = seen(f"{folder}/run", tag)
    options = ["--metric", f"return={tag}", "--leave-out", "not_finite"]
    # TensorBoard draws a line back where a program started again and did not say so.
    goes_back = any(one[0] > other[0] for one, other in zip(curve, curve[1:]))
    return files, options, None if goes_back else [curve]


TABLES = [
    plain, not_finite, restarted, two_runs, several_files, same_step, separated, packed, parquet, json_lines,
    json_document, monitor, wide, odd_names,
]  # fmt: skip


def main(folder):
    cases = []
    for place in range(200):
        chance, here = random.Random(place), f"{folder}/{place:03}"
        os.makedirs(here)
        make = TABLES[place // 2 % len(TABLES)] if place % 2 == 0 else events
        files, options, runs = make(chance, here)
        files = [os.path.relpath(file, folder) for file in files]
        cases.append({"kind": make.__name__, "files": files, "options": options, "runs": runs})
    json.dump(cases, open(f"{folder}/cases.json", "w"))


main(sys.argv[1])
