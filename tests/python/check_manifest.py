"""Holds a Kubernetes manifest against the JSON Schema of its kind: check_manifest.py MANIFEST.yaml SCHEMA.json"""

import json
import sys

import jsonschema
import yaml

with open(sys.argv[1]) as file:
    manifest = yaml.safe_load(file)
with open(sys.argv[2]) as file:
    validator = jsonschema.Draft202012Validator(json.load(file))

problems = [f"{'.'.join(map(str, error.absolute_path))}: {error.message}" for error in validator.iter_errors(manifest)]
if problems:
    sys.exit("\n".join(problems))

# The schema does hold: the same manifest with one misspelt key is refused.
manifest["spec"]["completionsMode"] = manifest["spec"].pop("completionMode")
assert any("completionsMode" in error.message for error in validator.iter_errors(manifest)), "the schema lets mistakes pass"

# What the API server asks of an Indexed Job beyond the schema.
spec = manifest["spec"]
assert spec["completionsMode"] == "Indexed" and spec["template"]["spec"]["restartPolicy"] == "Never"
assert 1 <= spec["parallelism"] <= spec["completions"] and "backoffLimitPerIndex" in spec
assert {rule["action"] for rule in spec["podFailurePolicy"]["rules"]} <= {"FailJob", "FailIndex", "Ignore", "Count"}
names = {container["name"] for container in spec["template"]["spec"]["containers"]}
assert all(rule["onExitCodes"]["containerName"] in names for rule in spec["podFailurePolicy"]["rules"] if "onExitCodes" in rule)
