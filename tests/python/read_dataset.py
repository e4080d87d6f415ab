"""Reads datasets with Minari and holds every number against what the engine's own reader gives.

Arguments: folders of trials, each with a dataset and with expected.json beside it.
"""

import json
import pathlib
import sys

import gymnasium
import minari
import numpy as np

for trial in map(pathlib.Path, sys.argv[1:]):
    dataset = minari.MinariDataset(trial / "dataset" / "data")
    expected = json.loads((trial / "expected.json").read_text())
    steps = sum(len(episode["actions"]) for episode in expected["episodes"])
    assert dataset.total_episodes == len(expected["episodes"]) > 0, dataset.total_episodes
    assert dataset.total_steps == steps, (dataset.total_steps, steps)
    assert dataset.spec.dataset_id == "regimen/gathered-v0", dataset.spec
    for number, (found, wanted) in enumerate(zip(dataset.iterate_episodes(), expected["episodes"], strict=True)):
        assert found.id == number
        # Several seats are one agent here, which earns their mean.
        earned = np.array(wanted["rewards"]).reshape(len(wanted["actions"]), -1).mean(axis=1)
        whole = isinstance(dataset.action_space, gymnasium.spaces.MultiDiscrete)
        for name, expected_values in [("observations", wanted["observations"]), ("actions", wanted["actions"]), ("rewards", earned)]:
            values = getattr(found, name)
            assert values.dtype == (np.int64 if whole and name == "actions" else np.float64), (name, values.dtype)
            np.testing.assert_allclose(values, np.array(expected_values), rtol=1e-15 if name == "rewards" else 0)
        length = len(wanted["actions"])
        assert len(found.observations) == length + 1 and len(found) == length
        last = [False] * (length - 1) + [True]
        ended = {"Terminated": found.terminations, "Truncated": found.truncations}
        assert ended.pop(wanted["end"]).tolist() == last
        assert not any(ended.popitem()[1])
        assert all(found.observations[t] in dataset.observation_space for t in range(length + 1))
        assert all(found.actions[t] in dataset.action_space for t in range(length))
    assert list(dataset.storage.get_episode_metadata([0])) == [{"id": 0, "total_steps": len(expected["episodes"][0]["actions"])}]
    sampled = dataset.sample_episodes(2)
    assert len(list(sampled)) == 2
