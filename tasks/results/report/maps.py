"""The report's maps: worlds from above with the paths of failures, and a list of failures beside each.

A report shows a few failures that differ, and not the first hundred of one kind.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import numpy as np
from jaxtyping import Float

from specs.arn import arn
from specs.base import Spec
from specs.data.outcome_reasons import mark_of
from tasks.results.report.batch_columns import NOT_SET, PASSED, Episodes, FailedEpisode, Failures, read_ways
from tasks.results.report.facts import BatchFacts
from tasks.results.report.floor import FloorDrawing, dots_path, draw_floor, fit_line, way_path
from tasks.results.report.places import Worlds
from tasks.results.report.rows import clip, short_world

# At 24 worlds these are some 400 kB of page, whatever the size of the batch.
LISTED = 6
DRAWN = 24
_APART_M = 0.4


@dataclass(frozen=True)
class FailureChoice:
    """What is shown of one world's failures, as rows of the table of failures.

    Attributes:
        listed: Those that are told one by one, and numbered on the map.
        drawn: Those whose way is drawn, the listed ones among them.
        failures: How many there are in all.
    """

    listed: tuple[int, ...]
    drawn: tuple[int, ...]
    failures: int


def choose_failures(failures: Failures, worlds: Sequence[str]) -> dict[str, FailureChoice]:
    """Returns what is shown of the failures of each of the worlds.

    Reasons take turns, each in the order of the episodes, so that one that is rare is not hidden by one that is not;
    listed are first those that ended apart from one another.
    """
    codes = {name: code for code, name in enumerate(failures.world.names)}
    return {world: _choose(failures, codes.get(world, -1)) for world in worlds}


def _choose(failures: Failures, world: int) -> FailureChoice:
    rows = np.flatnonzero(failures.world.codes == world)
    by_reason = [
        rows[failures.reason.codes[rows] == reason][:DRAWN].tolist() for reason in range(len(failures.reason.names))
    ]
    turns = [row for turn in zip_longest(*by_reason) for row in turn if row is not None]
    drawn = turns[:DRAWN]
    return FailureChoice(
        listed=tuple(sorted(_spread_out(failures, drawn))), drawn=tuple(sorted(drawn)), failures=len(rows)
    )


def _spread_out(failures: Failures, rows: Sequence[int]) -> list[int]:
    far: list[int] = []
    for row in rows:
        ends = failures.final_m[far] - failures.final_m[row]
        if len(far) < LISTED and np.all(np.hypot(*ends.T) > _APART_M):
            far.append(row)
    near = [row for row in rows if row not in far]
    return [*far, *near][:LISTED]


MOST_MAPS = 24
_TOLERANCE_M = 0.03
# So that the drawn ways of all maps are less than a megabyte, however long episodes are.
_POINTS = 160
_DOTS = 150
_LONGEST = 160
_CM = (100.0, -100.0)


class WayDrawing(Spec):
    """Where a failed episode went.

    Attributes:
        mark: Which mark and colour its reason has.
        title: For who asks.
        path: Path data; ``x`` and ``y`` where it ended.
        number: Its number in the list, or empty.
    """

    mark: str
    title: str
    path: str
    x: int
    y: int
    number: str


class ListedFailure(Spec):
    """A failure in words, and how to see it again."""

    number: str
    job: int
    mark: str
    reason: str
    circumstances: str
    what: str
    replay: str


class WorldMap(Spec):
    """A world with its failures.

    Attributes:
        number: Makes its id on the page.
        dots: Path data of where episodes that passed ended.
        failures: How many there are; ``not_drawn`` and ``not_listed`` how many of them are left out.
    """

    number: int
    world: str
    drawing: FloorDrawing
    dots: str
    ways: tuple[WayDrawing, ...]
    listed: tuple[ListedFailure, ...]
    failures: int
    not_drawn: int
    not_listed: int


def worlds_to_map(failures: Failures, worlds: Sequence[str]) -> list[str]:
    """Returns the worlds that are drawn: most failures first, then in the batch's order."""
    counts = dict(
        zip(failures.world.names, np.bincount(failures.world.codes, minlength=len(failures.world.names)), strict=True)
    )
    return sorted(worlds, key=lambda world: -int(counts.get(world, 0)))[:MOST_MAPS]


def world_maps(
    facts: BatchFacts,
    episodes: Episodes,
    failures: Failures,
    failures_file: Path,
    worlds: Worlds,
) -> list[WorldMap]:
    """Returns maps of the worlds with most failures, as many as are looked at.

    Args:
        facts: The batch.
        episodes: Its episodes.
        failures: Those that did not pass.
        failures_file: ``failures.parquet``, for the ways.
        worlds: Its worlds.
    """
    names = worlds_to_map(failures, [name for name in facts.worlds if name in worlds.rooms])
    picks = choose_failures(failures, names)
    ways = read_ways(failures_file, sorted(row for pick in picks.values() for row in pick.drawn))
    label = short_world(tuple(facts.worlds))
    found: list[WorldMap] = []
    for number, name in enumerate(names, start=1):
        pick = picks[name]
        drawn = failures.read_rows(pick.drawn)
        numbers = {row: str(place) for place, row in enumerate(pick.listed, start=1)}
        found.append(
            WorldMap(
                number=number,
                world=label(name),
                drawing=draw_floor(worlds.load(name)),
                dots=dots_path(_ends(episodes, name)),
                ways=tuple(_way(each, ways[each.row], numbers.get(each.row, "")) for each in drawn),
                listed=tuple(_listed(facts, each, numbers[each.row]) for each in drawn if each.row in numbers),
                failures=pick.failures,
                not_drawn=pick.failures - len(pick.drawn),
                not_listed=pick.failures - len(pick.listed),
            )
        )
    return found


def _ends(episodes: Episodes, world: str) -> Float[np.ndarray, "ends 2"]:
    """Returns where episodes of a world that passed ended; of many, some spread evenly over them."""
    code = episodes.world.names.index(world) if world in episodes.world.names else -1
    rows = np.flatnonzero((episodes.world.codes == code) & (episodes.outcome == PASSED))
    return episodes.final_m[rows[:: max(1, -(-len(rows) // _DOTS))]]


def _way(failure: FailedEpisode, way_m: Float[np.ndarray, "poses 2"], number: str) -> WayDrawing:
    line = fit_line(way_m, _TOLERANCE_M, _POINTS)
    x, y = np.rint((line[-1] if len(line) else np.array(failure.final_m)) * _CM).astype(int).tolist()
    title = f"job {failure.index}: {failure.reason} after {failure.simulated_s:.1f} s"
    return WayDrawing(mark=mark_of(failure.reason).name, title=title, path=way_path(line), x=x, y=y, number=number)


def _listed(facts: BatchFacts, failure: FailedEpisode, number: str) -> ListedFailure:
    said = [f"seed {failure.seed}"]
    said += [
        f"{name} {clip(failure.environment.get(name, NOT_SET), 40)}"
        for name, values in facts.variables.items()
        if len(values) > 1
    ]
    said += [f"{failure.goals_reached} of {failure.goals_total} goals"] * bool(failure.goals_total)
    if failure.late or failure.stray:
        said.append(f"lock-step did not hold: {failure.late} stages late, {failure.stray} stray commands")
    return ListedFailure(
        number=number,
        job=failure.index,
        mark=mark_of(failure.reason).name,
        reason=f"{failure.reason} after {failure.simulated_s:.1f} s",
        circumstances=", ".join(said),
        what=clip(failure.failure_reason, _LONGEST),
        replay=f"simyard replay {arn('simulation-job', facts.store, f'{facts.batch}/{failure.index}')}",
    )
