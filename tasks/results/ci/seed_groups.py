"""Counts a batch in groups of episodes that differ in their seeds alone, for reports that list tests."""

import functools
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import NamedTuple, TypeVar

import pyarrow as pa

from specs.data.run_report import Verdict
from tasks.results.ci.full_report import CountedBatch, FailureExample, GroupReport, GroupState, ReasonCount, WorldReport
from tasks.results.statistics.intervals import Interval, IntervalFamily, share_alone
from tasks.results.statistics.over_worlds import WorldsLikeThese, worlds_like_these

MOST_GROUPS = 5_000
"""More are counted and not listed: what shows a JUnit file reads some 10 MB and no more."""
MOST_EXAMPLES = 3
_LONGEST = 300
_ROWS_AT_ONCE = 8_192
# What a group has in common, besides its world and its variables.
_APPLICATIONS = (
    *("robot_application", "robot_version", "robot_digest", "robot_package", "robot_launch_file"),
    *("simulation_application", "simulation_version", "simulation_digest", "simulation_package"),
    *("simulation_launch_file", "duration_s"),
)
_KEY = ("world", "environment", *_APPLICATIONS)


class _Key(NamedTuple):
    """What the episodes of a group have in common; ``applications`` are the values of those columns."""

    world: str
    applications: tuple[object, ...]
    environment: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class _Outcome:
    """What is read of a row of ``results.parquet``, besides what its group has in common."""

    status: str
    success: bool | None
    simulated_s: float


@dataclass(frozen=True)
class _FailedEpisode:
    """What is read of a row of ``failures.parquet``, likewise."""

    job: str
    index: int
    seed: int
    reason: str
    failure_reason: str
    goals_reached: int
    goals_total: int


RESULT_COLUMNS = (*_KEY, *(each.name for each in fields(_Outcome)))
"""What is read of ``results.parquet``."""
FAILURE_COLUMNS = (*_KEY, *(each.name for each in fields(_FailedEpisode)))
"""What is read of ``failures.parquet``."""
_Row = TypeVar("_Row", _Outcome, _FailedEpisode)
_ALWAYS_NAMED = ("robot_application", "robot_launch_file", "simulation_application", "simulation_launch_file")
_DIGITS = 12


class GroupRules(NamedTuple):
    """By what groups are called failed, and how their episodes are named.

    Attributes:
        verdict: The gate's; None if no gate answered.
        bar: The success rate that it asks for; None if it asks for none.
        confidence: Of the intervals.
        looks: At how many looks the batch might have been ended; 0 of one that was driven to its end.
        compared_with: Digests of robot applications that the gate only compares with.
        job_arn: What the ARNs of jobs begin with, up to their id.
        store_option: What a command needs to find the store, such as ``--store s3://bucket/prefix``; or empty.
    """

    verdict: Verdict | None = None
    bar: float | None = None
    confidence: float = 0.95
    looks: int = 0
    compared_with: Collection[str] = ()
    job_arn: str = ""
    store_option: str = ""


@dataclass
class _Group:
    passed: int = 0
    failed: int = 0
    crashed: int = 0
    canceled: int = 0
    simulated_s: float = 0.0
    reasons: Counter[str] = field(default_factory=Counter[str])
    # The worst episodes by reason, those that came least far.
    worst: dict[str, list[_FailedEpisode]] = field(default_factory=lambda: defaultdict(list))


_Groups = dict[_Key, _Group]


def count_groups(arn: str, results: pa.Table, failures: pa.Table, rules: GroupRules) -> CountedBatch:
    """Returns a batch in groups.

    Args:
        arn: The batch's.
        results: ``RESULT_COLUMNS`` of its results.
        failures: ``FAILURE_COLUMNS`` of its failures.
        rules: By what groups are called failed.
    """
    groups = _counted(results)
    _add_failures(groups, failures)
    names = _names(list(groups))
    states = {key: _state(key, group, rules) for key, group in groups.items()}
    shown = _shown(states)
    passed, ended = sum(each.passed for each in groups.values()), sum(map(_ended, groups.values()))
    size = sum(map(bool, map(_ended, groups.values())))
    family = IntervalFamily(size=size, confidence=rules.confidence, looks=rules.looks)
    reports = {
        key: _report(names[key], each, states[key], rules, family) for key, each in groups.items() if key in shown
    }
    return CountedBatch(
        arn=arn,
        episodes=ended,
        passed=passed,
        canceled=sum(each.canceled for each in groups.values()),
        rate=passed / ended if ended else None,
        interval=_interval(passed, ended, rules.confidence, rules.looks),
        confidence=rules.confidence,
        intervals=family.size,
        like_these=_like_these(groups, rules),
        bar=rules.bar,
        worlds=tuple(_worlds(reports)),
        left_out=len(groups) - len(shown),
        left_out_failed=sum(state in {"failed", "error"} for key, (state, _) in states.items() if key not in shown),
    )


def _counted(results: pa.Table) -> _Groups:
    groups: _Groups = {}
    for key, row in _rows(results, _Outcome):
        group = groups.get(key)
        if group is None:
            group = groups[key] = _Group()
        group.simulated_s += row.simulated_s
        group.passed += row.success is True
        group.failed += row.success is False
        group.canceled += row.success is None
        group.crashed += row.status == "Failed"
    return groups


def _add_failures(groups: _Groups, failures: pa.Table) -> None:
    """Adds why episodes did not pass, and the worst of them: those that came least far."""
    for key, row in _rows(failures, _FailedEpisode):
        group = groups.get(key)
        if group is None:
            continue
        group.reasons[row.reason] += 1
        kept = group.worst[row.reason]
        kept.append(row)
        kept.sort(key=lambda each: (each.goals_reached / each.goals_total if each.goals_total else 0.0, each.index))
        del kept[MOST_EXAMPLES:]


def _rows(table: pa.Table, kind: type[_Row]) -> Iterator[tuple[_Key, _Row]]:
    """Yields each row with the key of its group."""
    for part in table.to_batches(_ROWS_AT_ONCE):
        columns = {name: part.column(name).to_pylist() for name in part.schema.names}
        applications = zip(*(columns[name] for name in _APPLICATIONS), strict=True)
        variables = (tuple(sorted(each)) for each in columns["environment"])
        keys = map(_Key, columns["world"], applications, variables)
        yield from zip(keys, map(kind, *(columns[each.name] for each in fields(kind))), strict=True)


def _names(keys: Sequence[_Key]) -> dict[_Key, str]:
    """Returns what groups are called: what they drive, and whatever is not the same in all of them."""
    parts = {key: _parts(key) for key in keys}
    values: dict[str, set[str | None]] = defaultdict(set)
    all_names = dict.fromkeys(name for found in parts.values() for name in found)
    for found in parts.values():
        for name in all_names:
            values[name].add(found.get(name))
    several = [name for name in all_names if len(values[name]) > 1 and name not in _ALWAYS_NAMED]
    return {key: _name(found, several) for key, found in parts.items()}


def _parts(key: _Key) -> dict[str, str]:
    found = dict(zip(_APPLICATIONS, map(str, key.applications), strict=True))
    for name in ("robot_digest", "simulation_digest"):
        found[name] = found[name][:_DIGITS]
    # A variable may be called like a column.
    return found | {f"${name}": value for name, value in key.environment}


def _name(parts: Mapping[str, str], several: Sequence[str]) -> str:
    robot, launch, scenario, rooms = (parts[name] for name in _ALWAYS_NAMED)
    more = [f"{name.removeprefix('$')}={parts[name]}" for name in several if name in parts]
    return ", ".join([f"{robot} {launch} in {scenario} {rooms}", *more])


def _state(key: _Key, group: _Group, rules: GroupRules) -> tuple[GroupState, str]:
    """Returns what a group is called, and why that is not what its rate seems to say."""
    ended = _ended(group)
    if not ended:
        return "skipped", "all of its episodes were canceled"
    below = group.passed / ended < (1.0 if rules.bar is None else rules.bar)
    if not below:
        return "passed", ""
    if key.applications[_APPLICATIONS.index("robot_digest")] in rules.compared_with:
        return "passed", "this version is only compared with"
    if rules.verdict == "PASS":
        return "passed", "not all passed, but the gate is about all episodes together, and says PASS"
    return ("error" if group.crashed else "failed"), ""


def _shown(states: Mapping[_Key, tuple[GroupState, str]]) -> frozenset[_Key]:
    """Returns which groups are listed: those that are not as they should be before others."""
    order = sorted(states, key=lambda key: states[key][0] not in {"failed", "error"})
    return frozenset(order[:MOST_GROUPS])


def _like_these(groups: _Groups, rules: GroupRules) -> WorldsLikeThese:
    worlds: dict[str, tuple[int, int]] = {}
    for key, group in groups.items():
        passed, ended = worlds.get(key.world, (0, 0))
        worlds[key.world] = passed + group.passed, ended + _ended(group)
    early = "the batch might have ended early" if rules.looks else ""
    passed, ended = ([counts[at] for counts in worlds.values()] for at in (0, 1))
    return worlds_like_these(passed, ended, rules.confidence, refused=early)


def _worlds(groups: Mapping[_Key, GroupReport]) -> Iterator[WorldReport]:
    by_world: dict[str, list[GroupReport]] = defaultdict(list)
    for key, group in groups.items():
        by_world[key.world].append(group)
    one = len({world.partition("/")[0] for world in by_world}) == 1
    for world, found in by_world.items():
        label = world.partition("/")[2] or world if one else world
        yield WorldReport(world=world, label=label, groups=tuple(found))


def _report(
    name: str, group: _Group, state: tuple[GroupState, str], rules: GroupRules, family: IntervalFamily
) -> GroupReport:
    ended = _ended(group)
    return GroupReport(
        name=name,
        state=state[0],
        note=state[1],
        episodes=ended,
        passed=group.passed,
        crashed=group.crashed,
        canceled=group.canceled,
        rate=group.passed / ended if ended else None,
        interval=_interval(group.passed, ended, rules.confidence, rules.looks),
        together=_exact(group.passed, ended, family.each),
        simulated_s=group.simulated_s,
        reasons=tuple(ReasonCount(reason=reason, episodes=count) for reason, count in _most_frequent(group.reasons)),
        examples=tuple(_examples(group, rules)),
    )


def _examples(group: _Group, rules: GroupRules) -> Iterator[FailureExample]:
    """Yields the worst episode of each reason, most frequent reasons first; then the next worst of each."""
    ranks = [(rank, row) for reason, _ in _most_frequent(group.reasons) for rank, row in enumerate(group.worst[reason])]
    ranks.sort(key=lambda each: each[0])
    for _, row in ranks[:MOST_EXAMPLES]:
        job = f"{rules.job_arn}{row.job}"
        yield FailureExample(
            job=job,
            seed=row.seed,
            reason=row.reason,
            explanation=row.failure_reason[:_LONGEST],
            replay=" ".join(filter(None, ["simyard replay", job, rules.store_option])),
        )


def _most_frequent(reasons: Counter[str]) -> list[tuple[str, int]]:
    return sorted(reasons.items(), key=lambda each: (-each[1], each[0]))


def _ended(group: _Group) -> int:
    return group.passed + group.failed


@functools.lru_cache(maxsize=4096)
def _interval(passed: int, episodes: int, confidence: float, looks: int) -> Interval:
    return share_alone(passed, episodes, confidence, looks)


@functools.lru_cache(maxsize=4096)
def _exact(passed: int, episodes: int, confidence: float) -> Interval:
    return IntervalFamily(size=1, confidence=confidence).interval(passed, episodes)
