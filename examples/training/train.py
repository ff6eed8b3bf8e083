"""Trains a controller that sees a lidar and a goal, and nothing else, with PPO; writes it as a bundle with ONNX.

PPO: J. Schulman et al., Proximal Policy Optimization Algorithms, 2017 (arXiv:1707.06347). Run it from the repository:
`python examples/training/train.py`, then `simyard run examples/training/reactive.yaml`.
"""

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from bundle_files import ROBOT, Graph, write_bundle

import simyard
import simyard.gym  # before JAX, whose settings it makes

import jax  # isort: skip
import jax.numpy as jnp  # isort: skip

HERE = Path(__file__).resolve().parent
LIDAR = {"rays": 32, "range_m": 10.0, "height_m": 0.2}
# What the network is shown: clip(field * scale, low, high), as its declaration says it.
PARTS = [
    {"field": "ranges_m", "scale": 0.5, "low": 0.0, "high": 1.0},
    {"field": "ranges_m", "scale": 0.1, "low": 0.0, "high": 1.0},
    {"field": "goal_robot_m", "scale": 1.0, "low": -1.0, "high": 1.0},
    {"field": "goal_robot_m", "scale": 0.15, "low": -1.0, "high": 1.0},
]
HIDDEN, ENVS, HORIZON, EPOCHS, BATCHES = 64, 512, 32, 4, 4
GAMMA, LAMBDA, CLIP, RATE, ENTROPY = 0.99, 0.95, 0.2, 1e-3, 2e-3


class Rollout(NamedTuple):
    """What a horizon of steps gives, (steps, envs) first; ``valid`` is not a step that only began an episode."""

    seen: np.ndarray
    action: np.ndarray
    density: np.ndarray
    value: np.ndarray
    reward: np.ndarray
    terminated: np.ndarray
    over: np.ndarray
    valid: np.ndarray


def shown(observation):
    parts = [np.clip(observation[part["field"]] * part["scale"], part["low"], part["high"]) for part in PARTS]
    return np.concatenate(parts, axis=1).astype(np.float32)


def layers(key, sizes, last):
    scales = [*[2.0**0.5] * (len(sizes) - 2), last]
    keys = jax.random.split(key, len(scales))
    shapes = zip(keys, sizes[:-1], sizes[1:], scales, strict=True)
    return [(jax.nn.initializers.orthogonal(scale)(key, (one, two)), jnp.zeros(two)) for key, one, two, scale in shapes]


def run(network, x):
    for weight, bias in network[:-1]:
        x = jnp.tanh(x @ weight + bias)
    return x @ network[-1][0] + network[-1][1]


def density(actor, spread, seen, action):
    return jnp.sum(-0.5 * ((action - run(actor, seen)) / jnp.exp(spread)) ** 2 - spread, axis=-1)


@jax.jit
def act(weights, seen, noise):
    mean, spread = run(weights["actor"], seen), weights["spread"]
    action = mean + jnp.exp(spread) * noise
    return action, density(weights["actor"], spread, seen, action), run(weights["critic"], seen)[:, 0]


def loss(weights, batch):
    seen, action, before, advantage, target, valid = batch
    ratio = jnp.exp(density(weights["actor"], weights["spread"], seen, action) - before)
    gain = jnp.minimum(ratio * advantage, jnp.clip(ratio, 1 - CLIP, 1 + CLIP) * advantage)
    error = 0.5 * (run(weights["critic"], seen)[:, 0] - target) ** 2
    return jnp.sum(valid * (error - gain)) / jnp.sum(valid) - ENTROPY * jnp.sum(weights["spread"])


@jax.jit
def update(learned, rate, samples, key):
    """Returns weights, moments and count after some epochs of Adam (D. Kingma, J. Ba, 2015) over the samples."""

    def step(carry, batch):
        weights, (first, second), count = carry
        slope = jax.grad(loss)(weights, batch)
        norm = jnp.sqrt(sum(jnp.sum(each**2) for each in jax.tree.leaves(slope)))
        slope = jax.tree.map(lambda each: each * jnp.minimum(1.0, 0.5 / norm), slope)
        first = jax.tree.map(lambda old, new: 0.9 * old + 0.1 * new, first, slope)
        second = jax.tree.map(lambda old, new: 0.999 * old + 0.001 * new**2, second, slope)
        lean, wide = 1 - 0.9 ** (count + 1), 1 - 0.999 ** (count + 1)
        moved = jax.tree.map(
            lambda old, one, two: old - rate * (one / lean) / (jnp.sqrt(two / wide) + 1e-5), weights, first, second
        )
        return (moved, (first, second), count + 1), None

    order = jnp.concatenate([jax.random.permutation(each, len(samples[0])) for each in jax.random.split(key, EPOCHS)])
    batches = [each[order].reshape(EPOCHS * BATCHES, -1, *each.shape[1:]) for each in samples]
    return jax.lax.scan(step, learned, batches)[0]


def advantages(rollout, last):
    """Returns generalized advantages (arXiv:1506.02438), and what the values should have been."""
    after = np.concatenate([rollout.value[1:], last[None]])
    found, kept = np.zeros_like(rollout.value), np.zeros_like(last)
    for step in reversed(range(len(found))):
        error = rollout.reward[step] + GAMMA * after[step] * ~rollout.terminated[step] - rollout.value[step]
        kept = error + GAMMA * LAMBDA * ~rollout.over[step] * kept
        found[step] = kept
    return found, found + rollout.value


def train(envs, steps, seed):
    rng, key = np.random.default_rng(seed), jax.random.key(seed)
    seen, over = shown(envs.reset(seed=seed)[0]), np.zeros(envs.num_envs, bool)
    size, actions = seen.shape[1], envs.single_action_space.shape[0]
    one, two, key = jax.random.split(key, 3)
    weights = {
        "actor": layers(one, [size, HIDDEN, HIDDEN, actions], 0.01),
        "critic": layers(two, [size, HIDDEN, HIDDEN, 1], 1.0),
        "spread": jnp.full(actions, -0.5),
    }
    learned = (weights, (jax.tree.map(jnp.zeros_like, weights),) * 2, jnp.zeros(()))
    rounds, ended = steps // (envs.num_envs * HORIZON), []
    for turn in range(rounds):
        rows = []
        for _ in range(HORIZON):
            noise = rng.standard_normal((envs.num_envs, actions), np.float32)
            action, dense, value = map(np.asarray, act(weights, seen, noise))
            observation, reward, terminated, truncated, infos = envs.step(action)
            rows.append(
                (seen, action, dense, value, reward.astype(np.float32), terminated, terminated | truncated, ~over)
            )
            seen, over = shown(observation), terminated | truncated
            ended += infos["passed"][infos["_passed"]].tolist() if "passed" in infos else []
        rollout = Rollout(*map(np.stack, zip(*rows, strict=True)))
        found, target = advantages(rollout, np.asarray(act(weights, seen, noise)[2]))
        valid = found[rollout.valid]
        samples = (
            rollout.seen,
            rollout.action,
            rollout.density,
            (found - valid.mean()) / valid.std(),
            target,
            rollout.valid,
        )
        flat = [each.reshape(-1, *each.shape[2:]) for each in samples]
        key, own = jax.random.split(key)
        learned = update(learned, RATE * (1 - turn / rounds), flat, own)
        weights = learned[0]
        if turn % 10 == 9 or turn == rounds - 1:
            print(f"{(turn + 1) * envs.num_envs * HORIZON:>9,} steps: {np.mean(ended[-2000:] or [0]):.0%} arrive")
    return weights


def main():
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--steps", type=int, default=1_500_000, help="control steps of all robots together")
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--output", type=Path, default=HERE / "bundle", help="folder of the bundle")
    given = asked.parse_args()
    worlds = simyard.worlds(HERE / "rooms.yaml", count=16, seed=given.seed)
    envs = simyard.gym.SimyardVectorEnv(
        ENVS, worlds=worlds, robot=ROBOT.parent, sensors={"lidar": LIDAR}, environment={"GOALS": "1"}, duration_s=30.0
    )
    began = time.monotonic()
    weights = train(envs, given.steps, given.seed)
    graph, actor = Graph("reactive"), weights["actor"]
    graph.dense("shown", actor, "action")
    declared = {"lidar": LIDAR, "inputs": [{"parts": PARTS}]}
    write_bundle(given.output, graph, {"shown": (len(actor[0][0]),)}, {"action": (len(actor[-1][1]),)}, declared)
    print(f"{given.output}: trained in {time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
