"""Groups episodes into chunks: a chunk runs as the lanes of one compiled program.

The variables that RoboMaker set in each job say which job it is (docs/reference/robomaker.md, section 9); no program
depends on them.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

from specs.arn import ArnForm, arn
from specs.base import Spec
from specs.data.episode import CONTROL_HZ, ApplicationLaunch, EpisodeRequest
from specs.data.physics import application_variables, control_delay_steps, physical_factors

JOB_ID = "AWS_ROBOMAKER_SIMULATION_JOB_ID"
JOB_ARN = "AWS_ROBOMAKER_SIMULATION_JOB_ARN"
RUN_ID = "AWS_ROBOMAKER_SIMULATION_RUN_ID"
_NAMES = frozenset({JOB_ID, JOB_ARN, RUN_ID})


# They follow from the batch and the episode's place in it, so that a chunk that is simulated again, a replay and an
# audit see the same ones. They are no part of a plan, and decide no program: the lanes of a program are different
# jobs.
def job_variables(form: ArnForm, batch: str, index: int) -> dict[str, str]:
    """Returns the variables of one job.

    Args:
        form: Of the ARNs that clients see.
        batch: Its batch's id.
        index: Its episode's.
    """
    path = f"{batch}/{index}"
    own = form.robomakers(arn("simulation-job", form.store_id, path))
    run = hashlib.sha256(path.encode()).hexdigest()[:16]
    return {JOB_ID: own.rpartition("/")[2], JOB_ARN: own, RUN_ID: f"run-{run}"}


def without_job_variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Returns an environment without what tells one job from another."""
    return {name: value for name, value in environment.items() if name not in _NAMES}


ProgramKey = tuple[str, ...]
# 1.25 simulated seconds: how often the host looks whether all lanes are done, or whether it shall stop.
SLICE_STEPS = 25
# Texts that are known to be numbers or not: a batch has few values, and each episode has them.
_NUMBERS_KNOWN = 1024


# A chunk is the unit of work, of resume and of progress. How requests fall into chunks depends on the requests and
# the lane count alone, so that a resumed batch has the chunks of the unbroken one.
#
# A batch that may be ended early takes its episodes in a drawn order, so that any beginning of it stands for the
# whole. The order follows from the batch's plan alone and from no library's release.
class Chunk(Spec):
    """The lanes of one run of a compiled program.

    Attributes:
        number: Position among the batch's chunks, from 0.
        requests: At most as many as there are lanes, all with the same program key.
    """

    number: int
    requests: tuple[EpisodeRequest, ...]


def plan_chunks(requests: Sequence[EpisodeRequest], lanes: int) -> list[Chunk]:
    """Returns the chunks of a batch, in order of their first request.

    Args:
        requests: All episodes of the batch.
        lanes: Most episodes in a chunk, at least 1.

    Raises:
        ValueError: ``lanes`` is below 1.
    """
    if lanes < 1:
        raise ValueError(f"lanes: {lanes}: at least 1")
    groups: dict[ProgramKey, list[EpisodeRequest]] = {}
    for request in requests:
        groups.setdefault(program_key(request), []).append(request)
    parts = [group[start : start + lanes] for group in groups.values() for start in range(0, len(group), lanes)]
    return [Chunk(number=number, requests=tuple(part)) for number, part in enumerate(parts)]


def most_steps(requests: Sequence[EpisodeRequest]) -> int:
    """Returns how many control steps some episodes have at most, the last slice of them whole."""
    longest_s = max((request.duration_s for request in requests), default=0.0)
    return SLICE_STEPS * (1 + round(longest_s * CONTROL_HZ) // SLICE_STEPS)


def program_key(request: EpisodeRequest) -> ProgramKey:
    """Returns what makes two episodes share a program: the applications, the variables' names, and their texts.

    Numeric variables enter the program as values, so a sweep over them is one program.
    """
    environment = without_job_variables(request.environment)
    numbers, texts = split_environment(environment)
    physical = ("|", "physical") if physical_factors(environment) else ()
    delayed = ("|", "delayed") if control_delay_steps(environment) is not None else ()
    pairs = tuple(part for name in sorted(texts) for part in (name, texts[name]))
    return (
        *_launch_key(request.robot),
        *_launch_key(request.scenario),
        "|",
        *sorted(numbers),
        "|",
        *pairs,
        *physical,
        *delayed,
    )


def split_environment(environment: Mapping[str, str]) -> tuple[dict[str, float], dict[str, str]]:
    """Returns the variables whose value is a finite decimal number, and the others, as applications see them."""
    numbers: dict[str, float] = {}
    texts: dict[str, str] = {}
    for name, text in application_variables(environment).items():
        number = _number(text)
        if number is None:
            texts[name] = text
        else:
            numbers[name] = number
    return numbers, texts


def _launch_key(launch: ApplicationLaunch) -> ProgramKey:
    return (launch.digest, launch.package, launch.launched)


@lru_cache(maxsize=_NUMBERS_KNOWN)
def _number(text: str) -> float | None:
    """Returns the number, or None; words such as ``nan`` and ``infinity``, and ``1_000``, stay texts."""
    if not set(text) <= set("0123456789+-.eE"):
        return None
    try:
        number = float(text)
    except ValueError:
        return None
    return number if abs(number) != float("inf") else None


@dataclass(frozen=True, eq=False)
class Shuffle:
    """A drawn order of some positions.

    Attributes:
        size: How many positions there are, from 0.
        seed: What the order follows from.
    """

    size: int
    seed: str

    @cached_property
    def order(self) -> tuple[int, ...]:
        """The positions, in their drawn order."""
        return tuple(sorted(range(self.size), key=self._drawn))

    @cached_property
    def turn(self) -> tuple[int, ...]:
        """For each position, when its turn is."""
        turns = [0] * self.size
        for turn, position in enumerate(self.order):
            turns[position] = turn
        return tuple(turns)

    def _drawn(self, position: int) -> bytes:
        return hashlib.sha256(f"{self.seed}/{position}".encode()).digest()
