"""JaxNav's robots: 256 at a time, one in each map, with 32 rays; all in one compiled loop. Runs where JaxMARL is.

Told how many others are in its map, too, a step is of one robot among those, which are robots with the same rays.
"""

import os
import sys

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import jax
import jax.numpy as jnp
from jaxmarl.environments.jaxnav.jaxnav_env import JaxNav  # pyright: ignore[reportMissingImports]

from benchmarks.rivals.turns import answer_turns

ROBOTS, RAYS, OTHERS, TOGETHER = int(sys.argv[1]), int(sys.argv[2]), int((*sys.argv, "0")[3]), 50


def main() -> None:
    """Answers turns: robots turn and drive by actions drawn in the loop.

    `step_env` leaves out the maps that `step` draws and throws away in each step, ten times as fast; robots that have
    ended stay, at the same cost.
    """
    env = JaxNav(num_agents=1 + OTHERS, lidar_num_beams=RAYS)

    def one(state: object, key: jax.Array) -> tuple[object, jax.Array]:
        keys = jax.random.split(key, ROBOTS)
        low, high = jnp.array([0.0, -0.6]), jnp.array([1.0, 0.6])
        actions = jax.random.uniform(key, (len(env.agents), ROBOTS, 2), minval=low, maxval=high)
        seen, state, *_ = jax.vmap(env.step_env)(keys, state, dict(zip(env.agents, actions, strict=True)))
        return state, seen[env.agents[0]].sum()

    @jax.jit
    def many(state: object, key: jax.Array) -> tuple[object, jax.Array]:
        state, sums = jax.lax.scan(one, state, jax.random.split(key, TOGETHER))
        return state, sums.sum()

    _, state = jax.vmap(env.reset)(jax.random.split(jax.random.key(0), ROBOTS))
    held, key = [state], [jax.random.key(1)]

    def step() -> int:
        key[0], used = jax.random.split(key[0])
        held[0], total = many(held[0], used)
        jax.block_until_ready(total)
        return TOGETHER

    answer_turns(ROBOTS, step)


if __name__ == "__main__":
    main()
