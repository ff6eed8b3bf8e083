"""Velocities that keep moving discs apart, beside those of RVO2, the authors' own library."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from tasks.simulate.lane.orca import Disc, Vector, nearest_velocity, neighbour_plane

# Figures of pyrvo, which wraps RVO2; the file says how they were made.
RVO2 = json.loads((Path(__file__).parent / "data" / "rvo2_steps.json").read_text())["cases"]
STEP_S, HORIZON_S, RADIUS_M, MOST_M_S = 0.05, 2.0, 0.25, 1.3


def chosen(place: jax.Array, velocity: jax.Array, preferred: jax.Array, others: jax.Array) -> jax.Array:
    """Returns the velocity of a disc among others (x, y, velocity x, velocity y), nearest first."""
    radius, yes = jnp.float32(RADIUS_M), jnp.ones((), bool)
    own = Disc(Vector(*place), Vector(*velocity), radius)
    planes = [
        neighbour_plane(
            own,
            Disc(Vector(*each[:2]), Vector(*each[2:]), radius),
            share=0.5,
            horizon_s=HORIZON_S,
            step_s=STEP_S,
            there=yes,
        )
        for each in others
    ]
    return jnp.stack(nearest_velocity(planes, 0, Vector(*preferred), jnp.float32(MOST_M_S)))


def test_discs_choose_the_velocities_that_rvo2_chooses() -> None:
    place, velocity, preferred, others, theirs = ([] for _ in range(5))
    for case in RVO2:
        places, velocities = np.array(case["places_m"]), np.array(case["velocities"])
        for number, found in enumerate(case["chosen"]):
            order = np.argsort(np.hypot(*(places - places[number]).T))[1:]
            place.append(places[number])
            velocity.append(velocities[number])
            preferred.append(case["preferred"][number])
            others.append(np.hstack([places, velocities])[order])
            theirs.append(found)
    ours = jax.jit(jax.vmap(chosen))(
        *(jnp.asarray(np.array(each), jnp.float32) for each in (place, velocity, preferred, others))
    )
    np.testing.assert_allclose(ours, np.array(theirs), atol=2e-4)
