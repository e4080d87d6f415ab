"""What a study came to. usage: wheel_collect.py STUDY STORE SEEDS.csv"""

import csv
import sys

import regimen

study, store, table = sys.argv[1:]
rows = regimen.collect(study, store=store)
assert [row["end"] for row in rows] == ["ok"] * 6, rows
with open(table) as file:
    shown = {(row["row"], int(row["seed"])): float(row["value"]) for row in csv.DictReader(file)}
assert shown == {(row["agent"], row["seed"]): row["return"] for row in rows}, (shown, rows)

missing = regimen.collect(study, set="seeds=4", store=store)
assert [row["end"] for row in missing].count(None) == 2, missing
try:
    regimen.collect(study, set=["sedes=4"], store=store)
except regimen.ConfigError as refusal:
    assert "did you mean `seeds`?" in str(refusal), refusal
else:
    raise AssertionError("not refused")
