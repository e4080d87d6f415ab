"""One step of the critic and one of the generator of E2GAN's published architecture in PyTorch, one thread. Prints JSON.

The step is that of `tests/benches/adversaries.rs`. usage: adversaries_torch.py LAYOUT CHANNELS BOTTOM CELLS BATCH SECONDS, where LAYOUT is
`first` (channels before height and width) or `last` (PyTorch's channels_last).
"""

import json
import statistics
import sys
import time

import torch
from torch import nn
from torch.nn import functional as F
from torch.nn.utils import spectral_norm

torch.set_num_threads(1)
torch.manual_seed(0)
LAYOUT = sys.argv[1]
CHANNELS, BOTTOM, CELLS, BATCH = map(int, sys.argv[2:6])
SECONDS, LATENT = float(sys.argv[6]), 128
FORMAT = torch.channels_last if LAYOUT == "last" else torch.contiguous_format


def enlargement(learnt, factor=2):
    if learnt:
        return nn.ConvTranspose2d(CHANNELS, CHANNELS, 2, 2)
    return nn.Upsample(scale_factor=factor, mode="bilinear", align_corners=False)


class Cell(nn.Module):
    def __init__(self, learnt, skip):
        super().__init__()
        block = lambda: [nn.Conv2d(CHANNELS, CHANNELS, 3, padding=1), nn.BatchNorm2d(CHANNELS), nn.ReLU()]
        self.first, self.second = nn.Sequential(enlargement(learnt), *block()), nn.Sequential(*block())
        self.shortcut = nn.Sequential(enlargement(learnt), nn.Conv2d(CHANNELS, CHANNELS, 1))
        self.skip = nn.Sequential(enlargement(False, 4), nn.Conv2d(CHANNELS, CHANNELS, 1)) if skip else None

    def forward(self, x, kept):
        h = self.first(x)
        if self.skip is not None:
            h = h + self.skip(kept[0])
        kept.append(h)
        return self.second(h) + self.shortcut(x)


class Generator(nn.Module):
    def __init__(self):
        super().__init__()
        self.stem = nn.Linear(LATENT, BOTTOM * BOTTOM * CHANNELS)
        self.cells = nn.ModuleList([Cell(at == 1, at == 2) for at in range(CELLS)])
        self.head = nn.Sequential(nn.BatchNorm2d(CHANNELS), nn.ReLU(), nn.Conv2d(CHANNELS, 3, 3, padding=1), nn.Tanh())

    def forward(self, z):
        x, kept = self.stem(z).view(-1, CHANNELS, BOTTOM, BOTTOM), []
        for cell in self.cells:
            x = cell(x, kept)
        return self.head(x)


class Residual(nn.Module):
    def __init__(self, kind):
        super().__init__()
        self.kind, inputs = kind, 3 if kind == "first" else CHANNELS
        convolution = lambda inputs, side: spectral_norm(nn.Conv2d(inputs, CHANNELS, side, padding=side // 2))
        self.first, self.second = convolution(inputs, 3), convolution(CHANNELS, 3)
        self.shortcut = convolution(inputs, 1) if kind != "keeping" else None

    def forward(self, x):
        h = self.second(F.relu(self.first(x if self.kind == "first" else F.relu(x))))
        if self.kind == "first":
            return F.avg_pool2d(h, 2) + self.shortcut(F.avg_pool2d(x, 2))
        return F.avg_pool2d(h, 2) + F.avg_pool2d(self.shortcut(x), 2) if self.kind == "halving" else h + x


class Discriminator(nn.Module):
    def __init__(self):
        super().__init__()
        kinds = ["first", "halving", "keeping"][:CELLS] + ["keeping"]
        self.blocks, self.linear = nn.Sequential(*map(Residual, kinds)), spectral_norm(nn.Linear(CHANNELS, 1, bias=False))

    def forward(self, x):
        return self.linear(F.relu(self.blocks(x)).sum((2, 3)))


generator, discriminator = Generator().to(memory_format=FORMAT), Discriminator().to(memory_format=FORMAT)
adam = lambda network: torch.optim.Adam(network.parameters(), 2e-4, (0.0, 0.9), fused=True)
of_generator, of_discriminator = adam(generator), adam(discriminator)
average = [p.detach().clone() for p in generator.parameters()]
side = BOTTOM << CELLS
real = (torch.rand(BATCH, 3, side, side) * 2 - 1).to(memory_format=FORMAT)


def critic_step():
    of_discriminator.zero_grad()
    with torch.no_grad():
        fake = generator(torch.randn(BATCH, LATENT))
    loss = F.relu(1 - discriminator(real)).mean() + F.relu(1 + discriminator(fake)).mean()
    loss.backward()
    of_discriminator.step()
    return loss.item()


def generator_step():
    of_generator.zero_grad()
    discriminator.requires_grad_(False)
    loss = -discriminator(generator(torch.randn(BATCH, LATENT))).mean()
    loss.backward()
    discriminator.requires_grad_(True)
    of_generator.step()
    with torch.no_grad():
        torch._foreach_lerp_(average, list(generator.parameters()), 0.001)
    return loss.item()


def timed(step):
    start = time.perf_counter()
    step()
    return time.perf_counter() - start


times, until = [], time.perf_counter() + SECONDS
while len(times) < 8 or time.perf_counter() < until:
    times.append((timed(critic_step), timed(generator_step)))
critic, step = (statistics.median(column) for column in zip(*times))
print(json.dumps({"who": f"PyTorch, channels {LAYOUT}", "critic_s": critic, "generator_s": step, "median_s": critic + step}))
