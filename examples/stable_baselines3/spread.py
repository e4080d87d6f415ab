"""Three soft actor-critics of Stable-Baselines3, each for itself, learn PettingZoo's simple_spread together.

The library learns with one agent; here every agent has a model of its own, whose buffer, noise and updates are the library's, and the loop
over the joint environment is written out. The output is a CSV file of what the greedy policies return in fresh episodes, mean of the agents
(which all earn nearly alike), which `experiments/first/python-spread.yaml` shows beside our own agent with the same settings.

usage: spread.py SEED [STEPS] > spread.csv
"""

import sys

import gymnasium
import numpy as np
import torch
from mpe2 import simple_spread_v3
from stable_baselines3 import SAC
from stable_baselines3.common.logger import configure

SEED = int(sys.argv[1])
STEPS = int(sys.argv[2]) if len(sys.argv) > 2 else 20_000
STARTS, EVERY, EPISODES, LAST_EPISODES = 1_000, 2_000, 50, 200


class Spaces(gymnasium.Env):
    """What a model asks of an environment that it is never shown."""

    def __init__(self, seen, done):
        self.observation_space, self.action_space = seen, done


def model(number, seen, done):
    made = SAC(
        "MlpPolicy",
        Spaces(seen, done),
        gamma=0.95,
        tau=0.01,
        batch_size=256,
        ent_coef="auto_0.1",
        policy_kwargs={"net_arch": [64, 64]},
        seed=1000 * SEED + number,
        device="cpu",
    )
    made.set_logger(configure(None, []))
    return made


def returns(models, environment, episodes, first):
    """Mean return of greedy policies, over episodes and agents."""
    sums = []
    for episode in range(episodes):
        seen, _ = environment.reset(seed=first + episode)
        total = 0.0
        while environment.agents:
            actions = {name: models[name].predict(seen[name], deterministic=True)[0] for name in environment.agents}
            seen, rewards, *_ = environment.step(actions)
            total += np.mean(list(rewards.values()))
        sums.append(total)
    return np.mean(sums)


torch.set_num_threads(1)
learned, measured = (simple_spread_v3.parallel_env(continuous_actions=True) for _ in range(2))
seen, _ = learned.reset(seed=SEED)
models = {name: model(number, learned.observation_space(name), learned.action_space(name)) for number, name in enumerate(learned.possible_agents)}
print("seed,step,return", flush=True)
for step in range(STEPS + 1):
    if step % EVERY == 0:
        episodes = LAST_EPISODES if step == STEPS else EPISODES
        print(f"{SEED},{step},{returns(models, measured, episodes, 1_000_000 * (SEED + 1))}", flush=True)
    actions = {name: models[name].predict(seen[name])[0] for name in learned.agents}
    following, rewards, terminations, truncations, _ = learned.step(actions)
    for name, action in actions.items():
        done = np.array([terminations[name] or truncations[name]])
        scaled = models[name].policy.scale_action(action)
        cut_off = [{"TimeLimit.truncated": truncations[name] and not terminations[name]}]
        models[name].replay_buffer.add(seen[name], following[name], scaled, np.array([rewards[name]]), done, cut_off)
    if step >= STARTS and step % 2 == 1:
        for of_agent in models.values():
            of_agent.train(gradient_steps=1, batch_size=256)
    seen = following if learned.agents else learned.reset()[0]
