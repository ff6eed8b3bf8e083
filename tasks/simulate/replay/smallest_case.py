"""The smallest case that still fails: a selection of furniture and a seed, neither of which can be made less.

Delta debugging finds a small part of a world that still makes an episode fail: Zeller and Hildebrandt 2002 (IEEE
Transactions on Software Engineering 28:183), algorithm ddmin: parts, then what is left without each part, in ever
smaller parts, until nothing can be left out any more. There a test is run after the other; here the tests of a round
are the lanes of one batch, and the smallest that fails is taken. What comes out is 1-minimal, as there in section 3.2:
without any single one of what is left the failure is gone.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import dist
from pathlib import Path
from typing import NamedTuple

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import batch_mounts
from tasks.simulate.host.declaration import most_lanes
from tasks.simulate.lane.recording import Recorder
from tasks.simulate.plan.chunks import Chunk, plan_chunks
from tasks.simulate.sandbox.sandbox_client import SandboxClient

# A robot's own length or two: nearer ends are one place of an apartment, such as a corner of a table.
SAME_PLACE_M = 1.0


class Ending(NamedTuple):
    """How an episode ended.

    Attributes:
        row: What came of it.
        goal_m: Where the robot was to go then (x, y); None where that is not known, as of an episode that never began.
    """

    row: EpisodeResult
    goal_m: tuple[float, float] | None = None

    @property
    def place_m(self) -> tuple[float, float]:
        """Returns where the robot was (x, y)."""
        return self.row.final_x_m, self.row.final_y_m


def is_of_same_kind(first: Ending, other: Ending) -> bool:
    """Returns whether status, failure code and outcome reason are the same."""
    return _kind(first.row) == _kind(other.row)


def is_same_failure(first: Ending, other: Ending) -> bool:
    """Returns whether it is the same failure: of one kind, on the way to the same goal, and in the same place.

    Goals are the same if they are the same in order and lie within ``SAME_PLACE_M``: furniture that is gone leaves
    scenarios another floor to draw them on. Places are the same if they lie within ``SAME_PLACE_M``.
    """
    return (
        is_of_same_kind(first, other)
        and is_same_goal(first, other)
        and dist(first.place_m, other.place_m) <= SAME_PLACE_M
    )


def is_same_goal(first: Ending, other: Ending) -> bool:
    """Returns whether two robots were on the way to the same goal."""
    if first.row.goals_reached != other.row.goals_reached:
        return False
    if first.goal_m is None or other.goal_m is None:
        return first.goal_m == other.goal_m
    return dist(first.goal_m, other.goal_m) <= SAME_PLACE_M


def _kind(row: EpisodeResult) -> tuple[str, str, str]:
    return row.status, row.failure_code, row.outcome_reason


# Of an episode, how it begins and ends is all that is looked at.
_ENDS_ALONE_HZ = 1e-6


class Trial(NamedTuple):
    """A world and a seed to try an episode with."""

    world: World
    seed: int


def simulate_trials(
    batch: OpenBatch, request: EpisodeRequest, trials: Sequence[Trial], bundles: Mapping[str, Path], *, engine: str = ""
) -> list[Ending]:
    """Returns how an episode ends in other worlds or with other seeds, in the order of the trials.

    Args:
        batch: The episode's; its lanes are those of its program.
        request: The episode.
        trials: Simulated together, as many at a time as the batch has lanes, and as this machine holds.
        bundles: Unpacked folders of the batch's applications, by digest.
        engine: What drove it, where that is known; else what the batch asked for.

    Raises:
        MemoryError: There is not enough memory for so many lanes.
    """
    asked = batch_mounts(batch).resolved(request)
    worlds = {f"trials/{number}": trial.world for number, trial in enumerate(trials)}
    requests = [
        asked.model_copy(update={"index": number, "world": world, "seed": trials[number].seed})
        for number, world in enumerate(worlds)
    ]
    most = min(batch.plan.lanes, most_lanes(requests, bundles) or batch.plan.lanes)
    endings: list[Ending] = []
    for chunk in plan_chunks(requests, most):
        recorder = Recorder(_ENDS_ALONE_HZ, lambda _: True)
        lanes = SandboxClient(
            bundles=bundles,
            lanes=batch.plan.lanes,
            engine=engine or batch.plan.engine,
            should_stop=lambda: False,
            rate_hz=_ENDS_ALONE_HZ,
            recorder=recorder,
        )
        endings += _endings(chunk, worlds, lanes, recorder)
    return endings


def _endings(chunk: Chunk, worlds: Mapping[str, World], lanes: SandboxClient, recorder: Recorder) -> list[Ending]:
    rows = lanes.simulate(chunk, worlds)
    goals = {
        int(index): (float(x_m), float(y_m))
        for part in recorder.parts()
        for index, (x_m, y_m) in zip(part["index"], part["goal_m"], strict=True)  # of an episode the last one stays
    }
    return [Ending(row, goals.get(row.index)) for row in rows]


Names = tuple[str, ...]
# Says of several selections whether the failure is still there with each, all simulated together; of fewer than it was
# asked, from the first one on, where no more may be tried.
StillFails = Callable[[Sequence[Names]], Sequence[bool]]


class MinimalSelection(NamedTuple):
    """What is left of a selection that fails.

    Attributes:
        names: What is left, in the order that it had.
        minimal: Whether each was left out by itself, and the failure was then gone; not where no more might be tried.
    """

    names: Names
    minimal: bool


def minimize_selection(names: Names, still_fails: StillFails) -> MinimalSelection:
    """Returns a selection that still fails and of which, unless the trials end before, no single one can be left out.

    Args:
        names: All of it; known to fail.
        still_fails: Tries selections; that it is asked again of one costs nothing.
    """
    left, parts = names, 1
    while parts <= len(left):
        alone, without = _round(left, parts)
        asked = list(dict.fromkeys([*alone, *without]))
        answers = still_fails(asked)
        failing = [selection for selection, fails in zip(asked, answers, strict=False) if fails]
        if failing:
            left = sorted(failing, key=len)[0]  # of equally small ones the first
            parts = 2 if left in alone else max(parts - 1, 2)
        elif parts == len(left) or len(answers) < len(asked):
            break
        else:
            parts = min(2 * parts, len(left))
    return leave_out_singles(left, still_fails)


def leave_out_singles(names: Names, still_fails: StillFails) -> MinimalSelection:
    """Returns what is left when single ones are left out until, unless the trials end before, none can be.

    A pass tries the selection without each one, all together. Those that can be left out by themselves are then left
    out together, as many as go, from the first one on; and another pass begins.

    Args:
        names: A selection that is known to fail.
        still_fails: Tries selections.
    """
    left = names
    while left:
        answers = still_fails([_without(left, (name,)) for name in left])
        loose = tuple(name for name, fails in zip(left, answers, strict=False) if fails)
        if not loose:
            return MinimalSelection(left, minimal=len(answers) == len(left))
        more = [_without(left, loose[:count]) for count in range(2, len(loose) + 1)]
        failing = [selection for selection, fails in zip(more, still_fails(more), strict=False) if fails]
        left = failing[-1] if failing else _without(left, loose[:1])
    return MinimalSelection((), minimal=True)


def _round(left: Names, parts: int) -> tuple[list[Names], list[Names]]:
    """Returns what is tried in a round: each part, and all but each part; at first nothing at all."""
    if parts == 1:
        return [()], []
    ends = [len(left) * number // parts for number in range(parts + 1)]
    alone = [left[begin:end] for begin, end in pairwise(ends)]
    return alone, [left[:begin] + left[end:] for begin, end in pairwise(ends)]


def _without(names: Names, out: Names) -> Names:
    return tuple(name for name in names if name not in out)


# Seeds that are looked at below the first; simulated together.
_SEEDS_AT_MOST = 64


class Case(NamedTuple):
    """What to try: the furniture that stays, and a seed."""

    names: Names
    seed: int


# Says of several cases whether the failure is still there, as ``StillFails`` does of selections.
StillFailsCase = Callable[[Sequence[Case]], Sequence[bool]]


def smallest_case(first: Case, still_fails: StillFailsCase) -> tuple[Case, bool]:
    """Returns a case that still fails, and whether it is known that it does not without any single piece.

    Another seed may need fewer pieces, and with fewer pieces another seed may fail. So both are made less in turn until
    neither can be: at its seed no single piece can be left out, and with its pieces no lower seed that was tried fails.

    Args:
        first: Known to fail.
        still_fails: Tries cases; that it is asked again of one costs nothing.
    """

    def at(seed: int) -> Callable[[Sequence[Names]], Sequence[bool]]:
        return lambda selections: still_fails([Case(names, seed) for names in selections])

    seed, found = first.seed, minimize_selection(first.names, at(first.seed))
    while (lower := _lowest_seed(found.names, seed, still_fails)) < seed:
        seed, found = lower, leave_out_singles(found.names, at(lower))
    return Case(found.names, seed), found.minimal


def _lowest_seed(names: Names, seed: int, still_fails: StillFailsCase) -> int:
    """Returns the lowest seed that still fails, of those below one that may be tried; that one at worst."""
    seeds = range(min(seed, _SEEDS_AT_MOST))
    answers = still_fails([Case(names, lower) for lower in seeds])
    return next((lower for lower, fails in zip(seeds, answers, strict=False) if fails), seed)
