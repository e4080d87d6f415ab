"""A rule and a learner for the pump beside this file, of the study `python-rule`."""

import pickle

import numpy as np


class Rule:
    """Mends from a threshold on."""

    def __init__(self, threshold):
        self.threshold = threshold

    def act(self, observation):
        return 1 if observation[0] >= self.threshold else 0


class Learner:
    """Learns the value of both actions at ten levels of wear."""

    def __init__(self, step_size=0.1):
        self.step_size, self.values = step_size, np.zeros((10, 2))

    def level(self, observation):
        return np.minimum(observation[:, 0] * 10, 9).astype(int)

    def act_batch(self, observations, explore, rng):
        best = self.values[self.level(observations)].argmax(axis=1)
        if not explore:
            return best
        return np.where(rng.random(len(best)) < 0.1, rng.integers(2, size=len(best)), best)

    def learn(self, batch):
        at, after = self.level(batch.observation), self.level(batch.next_observation)
        follows = np.where(batch.terminated, 0.0, self.values[after].max(axis=1))
        error = batch.reward + 0.95 * follows - self.values[at, batch.action]
        np.add.at(self.values, (at, batch.action), self.step_size * error)
        return {"loss": np.mean(error**2)}

    def save(self):
        return pickle.dumps(self.values)

    def load(self, data):
        self.values = pickle.loads(data)
