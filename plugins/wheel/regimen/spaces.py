"""Conversion between spaces and values of the simulators and those of Gymnasium."""

from __future__ import annotations

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from gymnasium.vector.utils import batch_space

# The tolerance of the simulators themselves.
SUM_TOLERANCE = 1e-6


class Simplex(Box):
    """Non-negative entries that sum to 1 along the last axis, as shares of a load.

    It is a `Box`, so that libraries that know boxes accept it; samples are uniform on the simplex. A vector of a box
    is generally not an allocation: `from_logits` lets agents for boxes act here.
    """

    def __init__(self, shape, seed=None):
        super().__init__(0.0, 1.0, shape, np.float64, seed)

    def sample(self, mask=None, probability=None):
        draws = self.np_random.standard_exponential(self.shape)
        return draws / draws.sum(axis=-1, keepdims=True)

    def contains(self, x):
        return super().contains(x) and bool(np.all(np.abs(np.sum(x, axis=-1, dtype=np.float64) - 1.0) <= SUM_TOLERANCE))

    def __repr__(self):
        return f"Simplex{self.shape}"

    def __eq__(self, other):
        return isinstance(other, Simplex) and self.shape == other.shape


@batch_space.register(Simplex)
def _several(space, n=1):
    return Simplex((n, *space.shape), seed=int(space.np_random.integers(2**31)))


def as_space(form):
    """A space of the simulators."""
    kind, size = form["kind"], len(form["names"])
    if kind == "box":
        return Box(np.array(form["low"], np.float64), np.array(form["high"], np.float64), (size,), np.float64)
    if kind == "simplex":
        return Simplex((size,))
    counts = [len(options) for _, options in form["options"]]
    return Discrete(counts[0]) if len(counts) == 1 else MultiDiscrete(counts)


def observed(form):
    """The observation form of a space: choices as a number per option."""
    if form["kind"] == "choices":
        return Box(-1.0, 1.0, (len(form["names"]),), np.float64)
    return as_space(form)


def as_value(space, numbers):
    """An observation, or a row of them, from its numbers."""
    if isinstance(space, Box):
        return numbers
    indices = numbers.astype(np.int64)
    return indices[0] if indices.ndim == 1 else indices[:, 0]


def n_observed(form):
    """Number of entries of an observation."""
    return 1 if form["kind"] == "discrete" else len(form["names"])


def from_logits(env, bound=3.0):
    """The environment for agents that act in boxes: actions in [-1, 1] are multiplied by `bound`, and their softmax is the
    allocation, so that the largest share is at most exp(2 `bound`) times the smallest. Takes an environment or a vector of
    them."""
    is_vector = isinstance(env, gymnasium.vector.VectorEnv)
    space = env.single_action_space if is_vector else env.action_space
    if not isinstance(space, Simplex):
        raise TypeError(f"`from_logits` is for allocations; the actions here are {space}")
    logits = Box(-1.0, 1.0, space.shape, np.float32)

    def allocation(action):
        scaled = bound * np.asarray(action, np.float64)
        shares = np.exp(scaled - scaled.max(axis=-1, keepdims=True))
        return shares / shares.sum(axis=-1, keepdims=True)

    if is_vector:
        return gymnasium.wrappers.vector.TransformAction(env, allocation, batch_space(logits, env.num_envs), logits)
    return gymnasium.wrappers.TransformAction(env, allocation, logits)
