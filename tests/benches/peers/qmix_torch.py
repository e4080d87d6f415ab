"""One update of QMIX in PyTorch, one thread. Prints the median time as JSON.

The update is that of `tests/benches/joint_learning.rs` for `value_decomposition` with its defaults: three seats with 18 observations and 5
choices each, a state of 54, batch 128, one network of width 64 for all seats, a mixing network of width 32. usage: qmix_torch.py SECONDS
"""

import json
import statistics
import sys
import time

import torch
from torch import nn

torch.set_num_threads(1)
torch.manual_seed(0)
SECONDS = float(sys.argv[1])
SEATS, OBSERVED, CHOICES, STATE, WIDTH, MIXING, BATCH = 3, 18, 5, 54, 64, 32, 128


class Networks(nn.Module):
    def __init__(self):
        super().__init__()
        self.seat = nn.Sequential(
            nn.Linear(OBSERVED + SEATS, WIDTH), nn.ReLU(), nn.Linear(WIDTH, WIDTH), nn.ReLU(), nn.Linear(WIDTH, CHOICES)
        )
        self.first_weights, self.first_bias = nn.Linear(STATE, SEATS * MIXING), nn.Linear(STATE, MIXING)
        self.second_weights = nn.Linear(STATE, MIXING)
        self.second_bias = nn.Sequential(nn.Linear(STATE, MIXING), nn.ReLU(), nn.Linear(MIXING, 1))

    def values(self, observations):
        which = torch.eye(SEATS).repeat(len(observations), 1)
        return self.seat(torch.cat([observations.view(-1, OBSERVED), which], dim=1))

    def mixed(self, values, state):
        weights = self.first_weights(state).abs().view(-1, SEATS, MIXING)
        hidden = nn.functional.elu(torch.bmm(values.unsqueeze(1), weights).squeeze(1) + self.first_bias(state))
        return (hidden * self.second_weights(state).abs()).sum(1, keepdim=True) + self.second_bias(state)


networks, target = Networks(), Networks()
target.load_state_dict(networks.state_dict())
target.requires_grad_(False)
optimizer = torch.optim.Adam(networks.parameters(), lr=5e-4, fused=True)


def update(observations, state, choices, rewards, next_observations, next_state):
    with torch.no_grad():
        best = networks.values(next_observations).argmax(1, keepdim=True)
        next_values = target.values(next_observations).gather(1, best).view(-1, SEATS)
        goal = rewards.mean(1, keepdim=True) + 0.99 * target.mixed(next_values, next_state)
    done = networks.values(observations).gather(1, choices.view(-1, 1)).view(-1, SEATS)
    loss = 0.5 * ((networks.mixed(done, state) - goal) ** 2).mean()
    optimizer.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(networks.parameters(), 10.0)
    optimizer.step()
    with torch.no_grad():
        torch._foreach_lerp_(list(target.parameters()), list(networks.parameters()), 0.005)


def uniform(size):
    return torch.rand(4096, size) * 2 - 1


buffer = [uniform(SEATS * OBSERVED), uniform(STATE), torch.randint(CHOICES, (4096, SEATS)), uniform(SEATS), uniform(SEATS * OBSERVED), uniform(STATE)]


def sampled():
    picked = torch.randperm(4096)[:BATCH]
    return [column[picked] for column in buffer]


for _ in range(15):
    update(*sampled())
times, until = [], time.perf_counter() + SECONDS
while time.perf_counter() < until:
    start = time.perf_counter()
    update(*sampled())
    times.append(time.perf_counter() - start)
print(json.dumps({"who": f"PyTorch {torch.__version__}", "median_s": statistics.median(times), "runs": len(times)}))
