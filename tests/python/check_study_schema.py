"""Holds studies as they are written against the JSON Schema for editors: check_study_schema.py SCHEMA.json STUDY.yaml..."""

import copy
import json
import re
import sys

import jsonschema
import yaml


class Loader(yaml.SafeLoader):
    """YAML 1.2's core schema, as editors read it: `<<` is a key, 1e-4 a number, `on` a word."""


Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if not tag.endswith((":merge", ":float", ":int", ":bool"))]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
Loader.add_implicit_resolver("tag:yaml.org,2002:bool", re.compile(r"^(?:true|false)$"), list("tf"))
Loader.add_implicit_resolver("tag:yaml.org,2002:int", re.compile(r"^[-+]?[0-9]+$"), list("-+0123456789"))
Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?$"), list("-+.0123456789")
)

with open(sys.argv[1]) as file:
    schema = json.load(file)
jsonschema.Draft202012Validator.check_schema(schema)
validator = jsonschema.Draft202012Validator(schema)


def problems(study):
    return [f"{'.'.join(map(str, error.absolute_path))}: {error.message[:200]}" for error in validator.iter_errors(study)]


studies = {}
for path in sys.argv[2:]:
    with open(path) as file:
        studies[path] = yaml.load(file, Loader)
wrong = [f"{path}: {problem}" for path, study in studies.items() for problem in problems(study)]
if wrong:
    sys.exit("\n".join(wrong))

# The schema does hold: a misspelt key is refused, with blocks beside it and without, and so is a missing section. Only a study that includes
# no other has its sections in its own file.
study = next(study for study in studies.values() if "include" not in study)
for change in (
    lambda it: it["protocol"].update({"train_evaluat": {}}),
    lambda it: it["protocol"].update({"<<": "common", "train_evaluat": {}}),
    lambda it: it.pop("agents"),
    lambda it: it["agents"].update({"<<": 3}),
):
    changed = copy.deepcopy(study)
    change(changed)
    assert problems(changed), "the schema lets mistakes pass"
# What a block or an included file may bring is not missed.
for change in (
    lambda it: it["agents"].update({"<<": ["one", "other"]}),
    lambda it: (it.pop("agents"), it.update({"include": "common.yaml"})),
):
    changed = copy.deepcopy(study)
    change(changed)
    assert not problems(changed), problems(changed)
