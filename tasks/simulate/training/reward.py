"""Rewards: what a control step was worth. A reward is a function in JAX of one lane's step, such as ``progress``."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from tasks.simulate.application.contract import TIMEOUT, Observation, Truth, Verdict

# What a goal is worth, and what the end of an episode costs that the robot brought about: in metres of way.
ARRIVAL_M, FAULT_M = 5.0, 5.0
# What a newton second of contact costs, and a control step: a robot that stands still shall lose.
CONTACT_M_PER_NS, STEP_M = 1.0, 0.005
# One step's contact costs no more than this many newton seconds: what blows up shall not blow up a network.
_MOST_NS = 1.0


class Transition(NamedTuple):
    """One control step of one lane, for its reward.

    Attributes:
        before, after: What the robot senses at the step's beginning and at its end.
        control: What drove it.
        truth: What really happened.
        verdict: What the scenario says of it, or the engine: time is up, the robot crashed.
        way_before_m, way_after_m: The way to the goal that it had at the step's beginning, from where it was then, and
            from where it is now.
    """

    before: Observation
    after: Observation
    control: Float[jax.Array, "actuators"]
    truth: Truth
    verdict: Verdict
    way_before_m: Float[jax.Array, ""]
    way_after_m: Float[jax.Array, ""]


Reward = Callable[[Transition], Float[jax.Array, ""]]


def progress(step: Transition) -> Float[jax.Array, ""]:
    """Returns the metres of way that a step took off, with what contacts, arrivals and bad ends are worth in metres.

    It is the way before minus the way after, minus ``STEP_M``, minus ``CONTACT_M_PER_NS`` for each newton second of
    contact, plus ``ARRIVAL_M`` for each goal that was reached, minus ``FAULT_M`` where the episode ended with neither
    success nor the end of its time. The way is a potential, so that progress alone changes no best policy (A. Y. Ng,
    D. Harada, S. Russell, Policy Invariance under Reward Transformations, 1999).

    Args:
        step: What happened.
    """
    reached = step.verdict.goal_index - step.before.goal_index
    fault = step.verdict.done & (step.verdict.reason != 0) & (step.verdict.reason != TIMEOUT)
    contact_ns = jnp.minimum(step.truth.impulse_ns, _MOST_NS)
    gained_m = step.way_before_m - step.way_after_m - STEP_M - CONTACT_M_PER_NS * contact_ns
    return gained_m + ARRIVAL_M * reached.astype(jnp.float32) - FAULT_M * fault.astype(jnp.float32)
