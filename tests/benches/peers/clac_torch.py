"""One update of the constrained Lyapunov actor-critic in PyTorch, one thread. Prints the median time as JSON.

The update is that of `tests/benches/joint_learning.rs` for `clac` with its defaults: 18 observations, 2 actions, width 256, batch 256, two
hidden layers, one Lyapunov critic whose value is the sum of squares of its last layer, targets of critic and policy. usage: clac_torch.py SECONDS
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
OBSERVED, ACTED, WIDTH, BATCH = 18, 2, 256, 256


def hidden(inputs):
    return [nn.Linear(inputs, WIDTH), nn.LeakyReLU(), nn.Linear(WIDTH, WIDTH), nn.LeakyReLU()]


policy, target_policy = (nn.Sequential(*hidden(OBSERVED), nn.Linear(WIDTH, 2 * ACTED)) for _ in range(2))
lyapunov, target_lyapunov = (nn.Sequential(*hidden(OBSERVED + ACTED)) for _ in range(2))
for target, source in ((target_policy, policy), (target_lyapunov, lyapunov)):
    target.load_state_dict(source.state_dict())
    target.requires_grad_(False)
log_multiplier, log_temperature = (torch.full((1,), first).log().requires_grad_() for first in (0.1, 2.0))
lyapunov_optimizer = torch.optim.Adam(lyapunov.parameters(), lr=3e-4, fused=True)
policy_optimizer = torch.optim.Adam(policy.parameters(), lr=1e-4, fused=True)
weight_optimizers = [torch.optim.Adam([weight], lr=1e-4, fused=True) for weight in (log_multiplier, log_temperature)]


def value(network, observation, action):
    return (network(torch.cat([observation, action], dim=1)) ** 2).sum(1, keepdim=True)


def draw(head):
    mean, log_sd = head.chunk(2, dim=1)
    log_sd = log_sd.clamp(-20, 2)
    noise = torch.randn_like(mean)
    x = mean + log_sd.exp() * noise
    log_density = -0.5 * noise**2 - log_sd - 0.9189385 - 2 * (0.6931472 - x - nn.functional.softplus(-2 * x))
    return torch.tanh(x), log_density.sum(1, keepdim=True)


def update(observation, action, cost, following, before):
    with torch.no_grad():
        goal = cost + 0.99 * value(target_lyapunov, following, draw(target_policy(following))[0])
    loss = 0.5 * ((value(lyapunov, observation, action) - goal) ** 2).mean()
    lyapunov_optimizer.zero_grad()
    loss.backward()
    lyapunov_optimizer.step()
    lyapunov.requires_grad_(False)
    rise = value(lyapunov, following, draw(policy(following))[0]) - value(lyapunov, observation, action)
    violation = (rise + cost).mean()
    head = policy(observation)
    log_pi = draw(head)[1].mean()
    moves = torch.tanh(head[:, :ACTED]) - torch.tanh(policy(before)[:, :ACTED])
    change = ((moves**2).sum(1) + 1e-12).sqrt().mean()
    multiplier, temperature = log_multiplier.exp().detach().clamp(max=1), log_temperature.exp().detach()
    loss = violation * multiplier + log_pi * temperature + 0.5 * change
    policy_optimizer.zero_grad()
    loss.backward()
    policy_optimizer.step()
    lyapunov.requires_grad_(True)
    for weight, optimizer, excess in zip((log_multiplier, log_temperature), weight_optimizers, (violation, log_pi - ACTED)):
        optimizer.zero_grad()
        (-weight * excess.detach()).sum().backward()
        optimizer.step()
    with torch.no_grad():
        torch._foreach_lerp_(list(target_lyapunov.parameters()), list(lyapunov.parameters()), 0.005)
        torch._foreach_lerp_(list(target_policy.parameters()), list(policy.parameters()), 0.005)


buffer = [torch.rand(4096, size) * 2 - 1 for size in (OBSERVED, ACTED, 1, OBSERVED, OBSERVED)]
buffer[2] = buffer[2].abs()


def sampled():
    picked = torch.randint(4096, (BATCH,))
    return [column[picked] for column in buffer]


for _ in range(15):
    update(*sampled())
times, until = [], time.perf_counter() + SECONDS
while time.perf_counter() < until:
    start = time.perf_counter()
    update(*sampled())
    times.append(time.perf_counter() - start)
print(json.dumps({"who": f"PyTorch {torch.__version__}", "median_s": statistics.median(times), "runs": len(times)}))
