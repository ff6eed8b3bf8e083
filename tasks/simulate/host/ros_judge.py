"""Episodes that a simulation application of ROS judges: by tags of its job, by its test nodes' ends, or by time.

RoboMaker had no word for whether a robot did its task. Its users' test nodes gave their job tags such as
``<test>_Status: Passed``, and cancelled it (github.com/aws-robotics, aws-robomaker-sample-application-*).
"""

import math
import re
from collections.abc import Mapping
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from specs.data.episode import EpisodeResult
from specs.data.outcomes import OutcomeReason
from specs.data.world import World, start_pose
from tasks.simulate.application.contract import HostMap, Placement, State, Truth, Verdict

_PASSED = frozenset({"passed", "pass", "success", "succeeded"})
_FAILED = frozenset({"failed", "fail", "failure"})
_NOT_IN_A_NAME = re.compile(r"[^a-z0-9]+")
_METRIC = re.compile(r"[a-z][a-z0-9_]{0,62}")
PLACINGS = "set_by_hand"
"""The metric of a row whose robot its application set elsewhere: in how many control steps."""
TimeOver = Literal["passed", "failed"]


class UntilJudged:
    """The scenario of such episodes, as the program knows it: it has no goals, and goes on until others end it."""

    arrived_m = None

    def place(self, world: World, floor: HostMap, hull_radius_m: float, rng: np.random.Generator) -> Placement:  # noqa: ARG002 - as of every scenario
        """Returns the world's start, which stands for the one goal that an episode has to have."""
        start = start_pose(world)
        pose = np.array([start.x_m, start.y_m, start.yaw_rad])
        return Placement(pose, pose[None, :2])

    def init(self, start: Float[jax.Array, "3"], goals_m: Float[jax.Array, "goals 2"]) -> State:  # noqa: ARG002 - likewise
        """Returns no state."""
        return ()

    def step(self, state: State, truth: Truth) -> tuple[State, Verdict]:  # noqa: ARG002 - likewise
        """Returns that the episode goes on."""
        return state, Verdict(jnp.zeros((), jnp.int32), jnp.zeros((), bool), jnp.zeros((), jnp.int32))


def until_judged(environment: Mapping[str, object]) -> UntilJudged:  # noqa: ARG001 - as every scenario is made
    """Returns the scenario; the application reads its variables itself."""
    return UntilJudged()


class Judgement(NamedTuple):
    """What an application says of its episode.

    Attributes:
        passed: What its tags and its test nodes say together; None if they say nothing.
        ended: Whether it ended the episode.
        time_over: What an episode is whose time is over, and of which nothing is said.
        tags: Of its job.
        reason: Why it did not pass, if it says so.
        placings: In how many control steps its nodes set the robot elsewhere.
    """

    passed: bool | None
    ended: bool
    time_over: TimeOver
    tags: Mapping[str, str]
    reason: OutcomeReason = "judged"
    placings: int = 0


def judged_by(tags: Mapping[str, str], *, tests: bool | None) -> bool | None:
    """Returns what tags and test nodes say together: one that failed decides, then one that passed.

    Args:
        tags: Of the job; those whose value is another word say nothing.
        tests: Whether all test nodes passed; None while one runs, or without any.
    """
    said = {value.strip().lower() for value in tags.values()}
    if said & _FAILED or tests is False:
        return False
    return True if said & _PASSED or tests else None


def judged_row(row: EpisodeResult, judgement: Judgement) -> EpisodeResult:
    """Returns the row of an episode that an application judged.

    Args:
        row: Of the lane, as one that crashed where the application ended it, or as one whose time was over.
        judgement: The application's.
    """
    passed, reason = judgement.passed, judgement.reason
    if passed is None:
        passed, reason = judgement.time_over == "passed", "timeout"
    why: OutcomeReason = "" if passed else reason
    placed = {PLACINGS: float(judgement.placings)} if judgement.placings else {}
    return row.model_copy(
        update={
            "status": "Completed",
            "failure_code": "",
            "failure_reason": "",
            "outcome": "Passed" if passed else "Failed",
            "outcome_reason": why,
            **({"goals_reached": 0, "goals_total": 0} if judgement.reason == "judged" else {}),
            "metrics": {**row.metrics, **tag_metrics(judgement.tags), **placed},
            "trajectory": () if passed else row.trajectory,
        }
    )


def tag_metrics(tags: Mapping[str, str]) -> dict[str, float]:
    """Returns the tags whose value is a number, by the names that metrics have."""
    found: dict[str, float] = {}
    for key, text in tags.items():
        name = _NOT_IN_A_NAME.sub("_", key.lower()).strip("_")
        try:
            value = float(text)
        except ValueError:
            continue
        if math.isfinite(value) and _METRIC.fullmatch(name):
            found[name] = value
    return found
