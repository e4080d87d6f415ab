"""Lists and loads datasets with Minari as a user does, and takes every warning for an error.

Arguments: the root of Minari, then the ids that it holds.
"""

import os
import sys
import warnings

os.environ["MINARI_DATASETS_PATH"] = sys.argv[1]

import minari

warnings.simplefilter("error")
ids = sys.argv[2:]
listed = minari.list_local_datasets()
assert sorted(listed) == sorted(ids), listed
for name in ids:
    dataset = minari.load_dataset(name)
    assert dataset.spec.dataset_id == name and dataset.total_episodes == 3, dataset.spec
    assert 0 < listed[name]["dataset_size"] < 10, listed[name]
