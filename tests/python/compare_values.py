"""Compares what PyYAML reads with the values that were meant, types included: compare_values.py A.yaml A.json B.yaml B.json ..."""

import json
import sys

import yaml


def differences(read, meant, at):
    if type(read) is not type(meant):
        yield f"{at}: read {read!r}, meant {meant!r}"
    elif isinstance(meant, dict):
        if sorted(read) != sorted(meant):
            yield f"{at}: keys {list(read)}, meant {list(meant)}"
        for key in set(read) & set(meant):
            yield from differences(read[key], meant[key], f"{at}.{key}")
    elif isinstance(meant, list):
        if len(read) != len(meant):
            yield f"{at}: {len(read)} items, meant {len(meant)}"
        for index, (one, other) in enumerate(zip(read, meant)):
            yield from differences(one, other, f"{at}[{index}]")
    elif read != meant:
        yield f"{at}: read {read!r}, meant {meant!r}"


problems = []
numbers = 0
for document, values in zip(sys.argv[1::2], sys.argv[2::2]):
    with open(document, encoding="utf-8") as file:
        read = yaml.safe_load(file)
    with open(values, encoding="utf-8") as file:
        text = file.read()
    numbers += text.count("e-")
    problems += differences(read, json.loads(text), document)
if problems:
    sys.exit("\n".join(problems))
assert numbers > 0, "no small number was compared"
