"""One operation on images in PyTorch, forward and backward, one thread. Prints the median time as JSON.

The operations are those of `tests/benches/images.rs`. usage: images_torch.py LAYOUT OPERATION BATCH INPUTS OUTPUTS SIDE SECONDS, where LAYOUT
is `first` (channels before height and width) or `last` (PyTorch's channels_last).
"""

import json
import statistics
import sys
import time

import torch
import torch.nn.functional as F

torch.set_num_threads(1)
torch.manual_seed(0)
LAYOUT, NAME = sys.argv[1:3]
BATCH, INPUTS, OUTPUTS, SIDE = map(int, sys.argv[3:7])
SECONDS = float(sys.argv[7])
FORMAT = torch.channels_last if LAYOUT == "last" else torch.contiguous_format
SHAPES = {
    "convolve_3x3": (OUTPUTS, INPUTS, 3, 3),
    "convolve_1x1": (OUTPUTS, INPUTS, 1, 1),
    "deconvolve_2x2": (INPUTS, OUTPUTS, 2, 2),
    "spectral": (OUTPUTS, INPUTS, 3, 3),
}


def spectral(w):
    matrix = w.flatten(1)
    with torch.no_grad():
        v = F.normalize(matrix.T @ torch.ones(OUTPUTS), dim=0)
        u = F.normalize(matrix @ v, dim=0)
    return w / torch.dot(u, matrix @ v)


COMPUTE = {
    "convolve_3x3": lambda x, w, b: F.conv2d(x, w, b, padding=1),
    "convolve_1x1": lambda x, w, b: F.conv2d(x, w, b),
    "deconvolve_2x2": lambda x, w, b: F.conv_transpose2d(x, w, b, stride=2),
    "batch": lambda x, w, b: F.batch_norm(x, None, None, w.flatten(), b, training=True),
    "batch_relu": lambda x, w, b: F.relu(F.batch_norm(x, None, None, w.flatten(), b, training=True)),
    "instance": lambda x, w, b: F.instance_norm(x),
    "instance_relu": lambda x, w, b: F.relu(F.instance_norm(x)),
    "bilinear": lambda x, w, b: F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False),
    "nearest": lambda x, w, b: F.interpolate(x, scale_factor=2, mode="nearest"),
    "pool": lambda x, w, b: F.avg_pool2d(x, 2),
    "relu": lambda x, w, b: F.relu(x),
    "tanh": lambda x, w, b: torch.tanh(x),
    "spectral": lambda x, w, b: spectral(w),
}[NAME]


def tensor(*shape):
    return torch.randn(*shape).to(memory_format=FORMAT)


image, weight, bias = tensor(BATCH, INPUTS, SIDE, SIDE), tensor(*SHAPES.get(NAME, (OUTPUTS, 1, 1, 1))), torch.randn(OUTPUTS)
upstream = torch.randn_like(COMPUTE(image, weight, bias))


def both():
    leaves = [leaf.detach().requires_grad_() for leaf in (image, weight, bias)]
    COMPUTE(*leaves).backward(upstream)


for _ in range(3):
    both()
times, until = [], time.perf_counter() + SECONDS
while len(times) < 5 or time.perf_counter() < until:
    start = time.perf_counter()
    both()
    times.append(time.perf_counter() - start)
print(json.dumps({"who": f"PyTorch, channels {LAYOUT}", "median_s": statistics.median(times)}))
