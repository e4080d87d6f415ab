"""Evaluates exported policies with NumPy and compares the shares with those that the program recorded in the traced episode.

usage: evaluate_policy.py POLICY.safetensors...   (metrics.parquet lies beside each)
"""

import json
import struct
import sys
from pathlib import Path

import numpy
import polars


def read(path):
    data = Path(path).read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + length])
    metadata = json.loads(header.pop("__metadata__")["header"])
    tensors = {}
    for name, entry in header.items():
        begin, end = entry["data_offsets"]
        assert entry["dtype"] == "F32", entry
        tensors[name] = numpy.frombuffer(data[8 + length + begin : 8 + length + end], "<f4").reshape(entry["shape"])
    return metadata, tensors


ACTIVATIONS = {
    "relu": lambda x: numpy.maximum(x, 0),
    "leaky_relu": lambda x: numpy.where(x > 0, x, x * 0.01),
    "tanh": numpy.tanh,
}


def head(kind, x):
    if kind == "softmax_mean":
        x = numpy.exp(x - x.max())
    elif kind == "dirichlet_mean":
        x = numpy.log1p(numpy.exp(-abs(x))) + numpy.maximum(x, 0) + 1
    else:
        raise SystemExit(f"no head {kind}")
    return x / x.sum()


def two_layers(tensors, name, x):
    weight = lambda layer: tensors[f"{name}.layers.{layer}.weight"].astype(float)
    x = ACTIVATIONS["leaky_relu"](x @ weight(0) + tensors[f"{name}.layers.0.bias"])
    return x @ weight(1) + tensors[f"{name}.layers.1.bias"]


def evaluate_alike(metadata, tensors, x):
    assets = metadata["n_assets"]
    columns = []
    for first in metadata["blocks"]:
        block = x[first : first + assets]
        columns += [numpy.full(assets, block.mean()), block]
    columns += [numpy.full(assets, x[channel]) for channel in metadata["common"]]
    own = two_layers(tensors, "encoder", numpy.stack(columns, axis=1))
    beside = numpy.concatenate([own, numpy.tile(own.mean(axis=0), (assets, 1))], axis=1)
    return head(metadata["head"], two_layers(tensors, "head", beside)[:, 0])


def evaluate(metadata, tensors, observation):
    x = (numpy.asarray(observation) - metadata["center"]) / metadata["spread"]
    if metadata.get("architecture") == "equivariant":
        return evaluate_alike(metadata, tensors, x)
    layers = len(metadata["sizes"]) - 1
    for layer in range(layers):
        x = x @ tensors[f"policy.layers.{layer}.weight"].astype(float) + tensors[f"policy.layers.{layer}.bias"]
        x = ACTIVATIONS[metadata["activations"][layer]](x) if layer + 1 < layers else x
    return head(metadata["head"], x[: len(metadata["outputs"])])


for path in sys.argv[1:]:
    metadata, tensors = read(path)
    frame = polars.read_parquet(Path(path).with_name("metrics.parquet")).filter((polars.col("phase") == "trace") & (polars.col("episode") == 0))
    rows = {}
    for step, metric, value in frame.select("step", "metric", "value").rows():
        rows.setdefault(step, {})[metric] = value
    compared, worst = 0, 0.0
    for step in range(1, max(rows) + 1):
        seen = dict(rows[step - 1], power_demand_w=rows[step]["power_w"])
        ours = [rows[step][name] for name in metadata["outputs"]]
        theirs = evaluate(metadata, tensors, [seen[name] for name in metadata["inputs"]])
        worst = max(worst, abs(theirs - ours).max())
        compared += 1
    print(path, compared, "decisions, largest difference", worst)
    assert compared > 0 and worst < 1e-6, (compared, worst)
