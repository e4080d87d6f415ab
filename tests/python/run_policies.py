"""Checks ONNX files with onnx, computes them with onnxruntime and holds the actions against those that stand beside them.

usage: run_policies.py FOLDER   (beside each <name>.onnx lies <name>.json: observations, actions, scale, tolerance)
"""

import json
import sys
from pathlib import Path

import numpy
import onnx
import onnxruntime

PROPERTIES = {"program", "trial", "digest", "environment", "agent", "seed", "seat", "form", "head"}
LISTS = {"inputs": 1, "input_units": 1, "outputs": 2, "output_units": 2}


def describe(model, width, entries):
    properties = {entry.key: entry.value for entry in model.metadata_props}
    if not properties:
        return  # A head alone, of no trial.
    assert set(properties) == PROPERTIES | set(LISTS), properties
    for name, axis in LISTS.items():
        assert len(json.loads(properties[name])) == (width if axis == 1 else entries), (name, properties[name])


worst, files = 0.0, sorted(Path(sys.argv[1]).glob("*.onnx"))
options = onnxruntime.SessionOptions()
options.intra_op_num_threads = 1
for path in files:
    model = onnx.load(path)
    onnx.checker.check_model(model, full_check=True)
    case = json.loads(path.with_suffix(".json").read_text())
    observations = numpy.array(case["observations"], dtype=numpy.float32)
    assert (observations == case["observations"]).all(), "observations are of single precision"
    actions = numpy.array(case["actions"])
    describe(model, observations.shape[1], actions.shape[1])
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    assert [(port.name, port.shape, port.type) for port in session.get_inputs()] == [
        ("observation", ["batch", observations.shape[1]], "tensor(float)")
    ], path
    assert [(port.name, port.shape[1], port.type) for port in session.get_outputs()] == [
        ("action", actions.shape[1], "tensor(float)")
    ], path
    together = session.run(["action"], {"observation": observations})[0]
    alone = [session.run(["action"], {"observation": row[None]})[0][0] for row in observations[:3]]
    for found, expected in [(together, actions), (numpy.array(alone), actions[:3])]:
        assert found.dtype == numpy.float32 and found.shape == expected.shape, (path, found.shape)
        difference = (abs(found - expected) / case["scale"]).max()
        assert difference <= case["tolerance"], (path, difference, found, expected)
        worst = max(worst, difference)
assert files
print(len(files), "policies, largest difference", worst, "of the scale")
