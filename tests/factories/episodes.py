"""Episodes without a simulator: what a batch would have asked for and answered."""

from collections.abc import Sequence

from hypothesis import strategies as st

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from tasks.results.statistics.batch_summary import EpisodeCounts, EpisodeTally

ROBOT = ApplicationLaunch(
    name="courier", version="1", digest="a" * 64, package="courier", launch_file="go_to_goal"
)  # fmt: skip
SCENARIO = ApplicationLaunch(
    name="delivery", version="$LATEST", digest="b" * 64, package="delivery", launch_file="rooms"
)  # fmt: skip
TRAJECTORY = ((0.0, 0.0, 0.0, 0.0), (1.0, 0.3, 0.0, 0.1), (2.0, 0.6, 0.05, 0.2))


def request(
    index: int, *, world: str = "wgj-1/world-1-1", seed: int = 0, environment: dict[str, str] | None = None
) -> EpisodeRequest:
    """Returns what one lane is asked for."""
    return EpisodeRequest(
        index=index,
        world=world,
        seed=seed,
        robot=ROBOT,
        scenario=SCENARIO,
        environment=environment or {},
        duration_s=60.0,
    )


def passed(index: int) -> EpisodeResult:
    """Returns an episode that went well."""
    return EpisodeResult(
        index=index,
        status="Completed",
        failure_code="",
        failure_reason="",
        outcome="Passed",
        outcome_reason="",
        simulated_s=31.5,
        goals_reached=3,
        goals_total=3,
        path_length_m=12.25,
        shortest_path_m=11.0,
        spl=11.0 / 12.25,
        collisions=0,
        min_clearance_m=0.11,
        energy_j=42.0,
        final_x_m=4.0,
        final_y_m=-1.0,
        final_yaw_rad=0.5,
        trajectory=(),
    )


def collided(index: int) -> EpisodeResult:
    """Returns an episode that ran to its end without the robot doing its task."""
    return passed(index).model_copy(
        update={
            "outcome": "Failed",
            "outcome_reason": "collision",
            "goals_reached": 1,
            "spl": 0.0,
            "collisions": 2,
            "trajectory": TRAJECTORY,
        }
    )


def crashed(index: int) -> EpisodeResult:
    """Returns an episode whose job failed: the controller gave up, after all goals in this case."""
    return passed(index).model_copy(
        update={
            "status": "Failed",
            "failure_code": "RobotApplicationCrash",
            "failure_reason": "the controller returned a control that is no number",
        }
    )


def canceled(index: int) -> EpisodeResult:
    """Returns an episode that was stopped by a person."""
    return passed(index).model_copy(update={"status": "Canceled", "outcome": "Failed"})


def batch(successes: int, failures: int, cancels: int = 0) -> list[EpisodeResult]:
    """Returns results with so many of each kind."""
    kinds = [passed] * successes + [collided] * failures + [canceled] * cancels
    return [kind(index) for index, kind in enumerate(kinds)]


def counted(results: Sequence[EpisodeResult]) -> EpisodeCounts:
    """Returns what the results come to."""
    tally = EpisodeTally()
    tally.add([request(result.index) for result in results], results)
    return tally.counts()


numbers = st.floats(allow_nan=False, allow_infinity=False, width=32)
poses = st.lists(st.tuples(numbers, numbers, numbers, numbers), max_size=4).map(tuple)
environments = st.dictionaries(
    st.sampled_from(["MAX_SPEED", "MODE", "LIDAR"]), st.sampled_from(["0.3", "0.6", "fast", "nan", "1e3"]), max_size=3
)


@st.composite
def episodes(draw: st.DrawFn) -> tuple[Sequence[EpisodeRequest], Sequence[EpisodeResult]]:
    """Draws the requests and results of a batch of up to eight episodes, the results in any order."""
    kinds = draw(st.lists(st.sampled_from([passed, collided, crashed, canceled]), max_size=8))
    requests = [request(index, seed=index, environment=draw(environments)) for index in range(len(kinds))]
    results = [
        kind(index).model_copy(update={"trajectory": draw(poses), "energy_j": draw(numbers)})
        for index, kind in enumerate(kinds)
    ]
    return requests, draw(st.permutations(results))
