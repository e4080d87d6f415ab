"""The update of `sac_torch.py` in JAX, one jitted function, one thread. Prints the median time as JSON.

usage: sac_jax.py BATCH CRITIC_LAYERS POLICY_LAYERS SECONDS
"""

import json
import os
import statistics
import sys
import time

os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})

import jax
import jax.numpy as jnp
import numpy as np
import optax

BATCH, CRITIC_LAYERS, POLICY_LAYERS, SECONDS = (int(word) for word in sys.argv[1:5])
OBSERVATIONS, ACTIONS, WIDTH = 9, 4, 256


def network(key, inputs, outputs, layers):
    sizes = [inputs] + [WIDTH] * layers + [outputs]
    keys = jax.random.split(key, len(sizes))
    shape = lambda pair: jax.random.uniform(pair[0], pair[1], minval=-1, maxval=1) / pair[1][0] ** 0.5
    return [(shape((k, (a, b))), jnp.zeros(b)) for k, a, b in zip(keys, sizes, sizes[1:])]


def forward(layers, x):
    for index, (weight, bias) in enumerate(layers):
        x = x @ weight + bias
        x = jax.nn.leaky_relu(x) if index + 1 < len(layers) else x
    return x


def act(policy, observation, key):
    mean, log_sd = jnp.split(forward(policy, observation), 2, axis=-1)
    log_sd = jnp.clip(log_sd, -20, 2)
    noise = jax.random.normal(key, mean.shape)
    log_density = (-0.5 * noise**2 - log_sd - 0.9189385).sum(-1, keepdims=True)
    return jax.nn.softmax(mean + jnp.exp(log_sd) * noise), log_density


def least(pair, observation, action):
    inputs = jnp.concatenate([observation, action], axis=1)
    return jnp.minimum(forward(pair[0], inputs), forward(pair[1], inputs))


critic_adam, policy_adam, temperature_adam = optax.adam(3e-4), optax.adam(1e-4), optax.adam(3e-4)


def update(state, batch):
    key, policy, critics, targets, log_temperature, policy_state, critic_state, temperature_state = state
    observation, action, reward, terminal, following = batch
    key, first, second = jax.random.split(key, 3)
    temperature = jnp.exp(log_temperature)
    next_action, next_log_density = act(policy, following, first)
    goal = reward + 0.99 * (1 - terminal) * (least(targets, following, next_action) - temperature * next_log_density)
    inputs = jnp.concatenate([observation, action], axis=1)
    critic_loss = lambda pair: sum(((forward(one, inputs) - goal) ** 2).mean() for one in pair)
    change, critic_state = critic_adam.update(jax.grad(critic_loss)(critics), critic_state)
    critics = optax.apply_updates(critics, change)

    def policy_loss(weights):
        chosen, log_density = act(weights, observation, second)
        return (temperature * log_density - least(critics, observation, chosen)).mean(), log_density

    gradient, log_density = jax.grad(policy_loss, has_aux=True)(policy)
    change, policy_state = policy_adam.update(gradient, policy_state)
    policy = optax.apply_updates(policy, change)
    temperature_loss = lambda value: -(jnp.exp(value) * (log_density - ACTIONS)).mean()
    change, temperature_state = temperature_adam.update(jax.grad(temperature_loss)(log_temperature), temperature_state)
    log_temperature = optax.apply_updates(log_temperature, change)
    targets = jax.tree.map(lambda old, new: old + 0.005 * (new - old), targets, critics)
    return key, policy, critics, targets, log_temperature, policy_state, critic_state, temperature_state


keys = jax.random.split(jax.random.PRNGKey(0), 4)
policy = network(keys[0], OBSERVATIONS, 2 * ACTIONS, POLICY_LAYERS)
critics = tuple(network(key, OBSERVATIONS + ACTIONS, 1, CRITIC_LAYERS) for key in keys[1:3])
log_temperature = jnp.zeros(())
state = (keys[3], policy, critics, jax.tree.map(jnp.array, critics), log_temperature)
state += (policy_adam.init(policy), critic_adam.init(critics), temperature_adam.init(log_temperature))
random = np.random.default_rng(0)
normal = lambda *shape: jnp.asarray(random.standard_normal(shape), jnp.float32)
batch = (normal(BATCH, OBSERVATIONS), jax.nn.softmax(normal(BATCH, ACTIONS)), normal(BATCH, 1), jnp.zeros((BATCH, 1)), normal(BATCH, OBSERVATIONS))
step = jax.jit(update, donate_argnums=0)
for _ in range(15):
    state = step(state, batch)
jax.block_until_ready(state)
times = []
until = time.perf_counter() + SECONDS
while time.perf_counter() < until:
    start = time.perf_counter()
    state = step(state, batch)
    jax.block_until_ready(state)
    times.append(time.perf_counter() - start)
print(json.dumps({"who": f"JAX {jax.__version__} jit", "median_s": statistics.median(times), "runs": len(times)}))
