"""One soft actor-critic update in PyTorch, one thread. Prints the median time as JSON.

The update is that of `tests/benches/learning.rs`: softmax of a Gaussian candidate as the action, twin critics, tuned temperature,
Polyak targets; 9 observations, 4 actions. usage: sac_torch.py BATCH CRITIC_LAYERS POLICY_LAYERS SECONDS
"""

import json
import statistics
import sys
import time

import torch
from torch import nn

torch.set_num_threads(1)
torch.manual_seed(0)
BATCH, CRITIC_LAYERS, POLICY_LAYERS, SECONDS = (int(word) for word in sys.argv[1:5])
OBSERVATIONS, ACTIONS, WIDTH = 9, 4, 256


def network(inputs, outputs, layers):
    sizes = [inputs] + [WIDTH] * layers
    parts = []
    for before, after in zip(sizes, sizes[1:]):
        parts += [nn.Linear(before, after), nn.LeakyReLU()]
    return nn.Sequential(*parts, nn.Linear(WIDTH, outputs))


policy = network(OBSERVATIONS, 2 * ACTIONS, POLICY_LAYERS)
critics = nn.ModuleList(network(OBSERVATIONS + ACTIONS, 1, CRITIC_LAYERS) for _ in range(2))
targets = nn.ModuleList(network(OBSERVATIONS + ACTIONS, 1, CRITIC_LAYERS) for _ in range(2))
targets.load_state_dict(critics.state_dict())
targets.requires_grad_(False)
log_temperature = torch.zeros(1, requires_grad=True)
critic_optimizer = torch.optim.Adam(critics.parameters(), lr=3e-4, fused=True)
policy_optimizer = torch.optim.Adam(policy.parameters(), lr=1e-4, fused=True)
temperature_optimizer = torch.optim.Adam([log_temperature], lr=3e-4, fused=True)


def act(observation):
    mean, log_sd = policy(observation).chunk(2, dim=-1)
    log_sd = log_sd.clamp(-20, 2)
    noise = torch.randn_like(mean)
    log_density = (-0.5 * noise**2 - log_sd - 0.9189385).sum(-1, keepdim=True)
    return torch.softmax(mean + log_sd.exp() * noise, dim=-1), log_density


def least(pair, observation, action):
    inputs = torch.cat([observation, action], dim=1)
    return torch.min(pair[0](inputs), pair[1](inputs))


def update(observation, action, reward, terminal, following):
    temperature = log_temperature.exp().detach()
    with torch.no_grad():
        next_action, next_log_density = act(following)
        value = least(targets, following, next_action) - temperature * next_log_density
        goal = reward + 0.99 * (1 - terminal) * value
    inputs = torch.cat([observation, action], dim=1)
    critic_loss = sum(((critic(inputs) - goal) ** 2).mean() for critic in critics)
    critic_optimizer.zero_grad()
    critic_loss.backward()
    critic_optimizer.step()
    critics.requires_grad_(False)
    chosen, log_density = act(observation)
    policy_loss = (temperature * log_density - least(critics, observation, chosen)).mean()
    policy_optimizer.zero_grad()
    policy_loss.backward()
    policy_optimizer.step()
    critics.requires_grad_(True)
    temperature_loss = -(log_temperature.exp() * (log_density.detach() - ACTIONS)).mean()
    temperature_optimizer.zero_grad()
    temperature_loss.backward()
    temperature_optimizer.step()
    with torch.no_grad():
        torch._foreach_lerp_(list(targets.parameters()), list(critics.parameters()), 0.005)


batch = (
    torch.randn(BATCH, OBSERVATIONS),
    torch.softmax(torch.randn(BATCH, ACTIONS), dim=-1),
    torch.randn(BATCH, 1),
    torch.zeros(BATCH, 1),
    torch.randn(BATCH, OBSERVATIONS),
)
for _ in range(15):
    update(*batch)
times = []
until = time.perf_counter() + SECONDS
while time.perf_counter() < until:
    start = time.perf_counter()
    update(*batch)
    times.append(time.perf_counter() - start)
print(json.dumps({"who": f"PyTorch {torch.__version__}", "median_s": statistics.median(times), "runs": len(times)}))
