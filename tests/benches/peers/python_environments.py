"""Environment steps per second of vector environments in Python. usage: python_environments.py KIND ID ENVIRONMENTS SECONDS

KIND is `sb3` (SubprocVecEnv of Stable-Baselines3: a process and a pickled pipe for each environment), `async`
(AsyncVectorEnv of Gymnasium: a process for each, observations in shared memory), `sync` or `dummy` (those of Gymnasium and
Stable-Baselines3 within one process). Prints one line of JSON.
"""

import json
import sys
import time

import gymnasium
import numpy as np


def main():
    kind, name, count, seconds = sys.argv[1], sys.argv[2], int(sys.argv[3]), float(sys.argv[4])
    functions = [lambda: gymnasium.make(name, disable_env_checker=True)] * count
    if kind in ("sb3", "dummy"):
        import stable_baselines3
        from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

        environments = (SubprocVecEnv if kind == "sb3" else DummyVecEnv)(functions)
        who = f"{type(environments).__name__} of Stable-Baselines3 {stable_baselines3.__version__}"
    else:
        vector = gymnasium.vector.AsyncVectorEnv if kind == "async" else gymnasium.vector.SyncVectorEnv
        environments = vector(functions)
        who = f"{vector.__name__} of Gymnasium {gymnasium.__version__}"
    environments.reset()
    space = environments.action_space
    action = np.zeros((count, *getattr(space, "shape", ())[-1:]), space.dtype) if kind in ("sb3", "dummy") else np.zeros_like(space.sample())
    steps, start = 0, time.perf_counter()
    while time.perf_counter() - start < seconds:
        environments.step(action)
        steps += count
    rate = steps / (time.perf_counter() - start)
    environments.close()
    print(json.dumps({"who": who, "steps_per_s": rate, "environments": count}))


if __name__ == "__main__":
    main()
