"""One update of all seats of TDOM-AC, ROMMEO or PR2 in PyTorch, one thread. Prints the median time as JSON.

The update is that of `tests/benches/joint_learning.rs` with the agents' defaults: three seats, joint observations of 54, actions of 2, width
256, batch 256, normalised inputs, clipped gradients, the stale policy step. usage: joint_torch.py AGENT SECONDS [SAMPLES]
"""

import json
import statistics
import sys
import time

import torch
from torch import nn

torch.set_num_threads(1)
torch.manual_seed(0)
AGENT, SECONDS = sys.argv[1], float(sys.argv[2])
SAMPLES = int(sys.argv[3]) if len(sys.argv) > 3 else 1
SEATS, OBSERVED, ACTED, WIDTH, BATCH = 3, 54, 2, 256, 256
OTHERS = ACTED * (SEATS - 1)


class Network(nn.Module):
    def __init__(self, inputs, outputs):
        super().__init__()
        self.body = nn.Sequential(
            nn.BatchNorm1d(inputs), nn.Linear(inputs, WIDTH), nn.ReLU(), nn.Linear(WIDTH, WIDTH), nn.ReLU(), nn.Linear(WIDTH, outputs)
        )
        self.optimizer = torch.optim.Adam(self.body.parameters(), lr=3e-4, fused=True)

    def forward(self, *parts):
        return self.body(torch.cat(parts, dim=1))

    def step(self, loss):
        self.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.body.parameters(), 0.5)
        self.optimizer.step()


def density(mean, log_sd, x):
    terms = torch.distributions.Normal(mean, log_sd.exp()).log_prob(x) - torch.log(1 - torch.tanh(x) ** 2 + 1e-6)
    return terms.sum(1, keepdim=True)


def split(head):
    mean, log_sd = head.chunk(2, dim=1)
    return mean, log_sd.clamp(-20, 2)


def draw(head):
    mean, log_sd = split(head)
    x = mean + log_sd.exp() * torch.randn_like(mean)
    return torch.tanh(x), density(mean, log_sd, x), x


class Seat:
    def __init__(self):
        recursive = AGENT == "pr2"
        self.policy = Network(OBSERVED + (0 if recursive else OTHERS), 2 * ACTED)
        self.opponents = [Network(OBSERVED + (ACTED if recursive else 0), 2 * ACTED) for _ in range(SEATS - 1)]
        self.critic, self.target = Network(OBSERVED + SEATS * ACTED, 1), Network(OBSERVED + SEATS * ACTED, 1)
        self.prior = Network(OBSERVED, 2 * ACTED)


seats = [Seat() for _ in range(SEATS)]
buffer = [torch.rand(4096, size) * 2 - 1 for size in (OBSERVED, SEATS * ACTED, SEATS, OBSERVED)]


def others(index):
    return [other for other in range(SEATS) if other != index]


def replaced(actions, index, action):
    parts = list(actions.chunk(SEATS, dim=1))
    parts[index] = action
    return torch.cat(parts, dim=1)


def joint(index, own, predicted):
    parts = list(predicted)
    parts.insert(index, own)
    return torch.cat(parts, dim=1)


def critic_target(seat, index, following):
    if AGENT == "pr2":
        own, log_pi, _ = draw(seat.policy(following))
        answers = [[draw(model(following, own))[0] for model in seat.opponents] for _ in range(SAMPLES)]
        values = [seat.target(joint(index, own, answer), following) for answer in answers]
        return sum(values) / SAMPLES - log_pi
    draws = [draw(model(following)) for model in seat.opponents]
    predicted = [action for action, _, _ in draws]
    own, log_pi, _ = draw(seat.policy(following, *predicted))
    value = seat.target(joint(index, own, predicted), following)
    if AGENT == "tdom_ac":
        return value - 0.5 * (log_pi + sum(log_rho for _, log_rho, _ in draws))
    seen = [density(*split(seats[other].prior(following)), x) for other, (_, _, x) in zip(others(index), draws)]
    return value - log_pi + sum(seen) - sum(log_rho for _, log_rho, _ in draws)


def opponent_loss(seat, index, model, other, observed, actions):
    own = actions.chunk(SEATS, dim=1)[index]
    action, log_rho, x = draw(model(observed, own) if AGENT == "pr2" else model(observed))
    done = replaced(actions, other, action)
    if AGENT == "tdom_ac":
        return (log_rho - seats[other].critic(done, observed)).mean()
    loss = log_rho - seat.critic(done, observed)
    if AGENT == "rommeo":
        mixed = torch.cat([done.chunk(SEATS, dim=1)[at] for at in others(index)], dim=1)
        log_pi = density(*split(seat.policy(observed, mixed)), torch.atanh(0.9999 * own))
        loss = loss - density(*split(seats[other].prior(observed)), x) + log_pi
    return loss.mean()


def policy_loss(seat, index, observed):
    if AGENT == "pr2":
        own, log_pi, _ = draw(seat.policy(observed))
        answers = [[draw(model(observed, own))[0] for model in seat.opponents] for _ in range(SAMPLES)]
        return (log_pi - sum(seat.critic(joint(index, own, answer), observed) for answer in answers) / SAMPLES).mean()
    with torch.no_grad():
        predicted = [draw(model(observed))[0] for model in seat.opponents]
    own, log_pi, _ = draw(seat.policy(observed, *predicted))
    return (log_pi - seat.critic(joint(index, own, predicted), observed)).mean()


def update():
    for index, seat in enumerate(seats):
        picked = torch.randperm(4096)[:BATCH]
        observed, actions, rewards, following = (column[picked] for column in buffer)
        if AGENT == "rommeo":
            mean, log_sd = split(seat.prior(observed))
            x = torch.atanh(0.9999 * actions.chunk(SEATS, dim=1)[index])
            seat.prior.step(5e-4 * ((log_sd.exp() ** 2).mean() + (mean**2).mean()) - density(mean, log_sd, x).mean())
        with torch.no_grad():
            goal = rewards[:, index : index + 1] + 0.95 * critic_target(seat, index, following)
        seat.critic.step(((seat.critic(actions, observed) - goal) ** 2).mean())
        if seat.policy.body[1].weight.grad is not None:
            seat.policy.optimizer.step()
        for model, other in zip(seat.opponents, others(index)):
            model.step(opponent_loss(seat, index, model, other, observed, actions))
        seat.policy.step(policy_loss(seat, index, observed))
    with torch.no_grad():
        for seat in seats:
            for slow, fast in zip(seat.target.parameters(), seat.critic.parameters()):
                slow.lerp_(fast, 0.01)


for _ in range(3):
    update()
times, until = [], time.perf_counter() + SECONDS
while time.perf_counter() < until:
    start = time.perf_counter()
    update()
    times.append(time.perf_counter() - start)
figures = {"median_s": statistics.median(times), "fastest_s": min(times), "runs": len(times)}
print(json.dumps({"who": f"PyTorch {AGENT}", **figures}))
