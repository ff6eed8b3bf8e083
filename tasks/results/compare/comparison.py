"""Compares the tables of two batches: the episodes they have in common, and those that came out differently.

Episodes are the same if world, seed, environment and applications are; versions of applications are what is compared.
`differences` names what only one batch asked of its episodes, so that they have fewer of them in common.
"""

from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import pyarrow as pa

from specs.base import Spec
from specs.data.episode import short_reason
from tasks.results.statistics.pairs import episode_keys

_NAMED = 5
_NOT_SET = "(not set)"


def differences(
    first: pa.Table, second: pa.Table, worlds: Mapping[str, str], others: Mapping[str, str]
) -> Iterator[str]:
    """Yields what only one of two batches has: values of environment variables, worlds, seeds; a line each.

    Args:
        first: The rows of one batch's ``results.parquet``.
        second: The rows of the other's.
        worlds: What tells the first batch's worlds apart, by ``<generation>/<world>``.
        others: The same of the second batch.
    """
    one, other, unset = _variables(first), _variables(second), {_NOT_SET: None}
    for name in sorted(one.keys() | other.keys()):
        yield from _difference(name, one.get(name, unset), other.get(name, unset))
    yield from _difference("worlds", _worlds(first, worlds), _worlds(second, others), counted=True)
    yield from _difference("seeds", _seeds(first), _seeds(second))


def _variables(table: pa.Table) -> dict[str, dict[str, None]]:
    """Returns the values of each environment variable, in order; an episode may not set one that others do."""
    settings = dict.fromkeys(tuple(row) for row in table.column("environment").to_pylist())
    named = [dict(setting) for setting in settings]
    names = dict.fromkeys(name for setting in named for name in setting)
    return {name: {setting.get(name, _NOT_SET): None for setting in named} for name in names}


def _worlds(table: pa.Table, identities: Mapping[str, str]) -> dict[str, None]:
    return dict.fromkeys(identities.get(name, name) for name in table.column("world").unique().to_pylist())


def _seeds(table: pa.Table) -> dict[str, None]:
    return dict.fromkeys(map(str, sorted(table.column("seed").unique().to_pylist())))


def _difference(name: str, one: Collection[str], other: Collection[str], *, counted: bool = False) -> Iterator[str]:
    sides = ((one, other, "the first"), (other, one, "the second"))
    alone = [(_alone(mine, theirs), which) for mine, theirs, which in sides]
    said = [f"{len(own) if counted else _listing(own)} only in {which}" for own, which in alone if own]
    if said:
        yield f"{name}: {'; '.join(said)}"


def _alone(mine: Iterable[str], theirs: Collection[str]) -> list[str]:
    return [value for value in mine if value not in theirs]


def _listing(values: list[str]) -> str:
    more = f" and {len(values) - _NAMED} more" if len(values) > _NAMED else ""
    return ", ".join(values[:_NAMED]) + more


_LAUNCHED = ("robot", "simulation")
_ORIGINS = ("robot_version", "robot_digest", "simulation_digest", "duration_s", "engine", "device")
_ASKED = ("simulation_digest", "duration_s")
_COLUMNS = ("index", "world", "seed", "environment", "success", "status", "failure_code", "outcome_reason", "recording")


@dataclass(frozen=True)
class ComparedEpisode:
    """An episode as far as it is compared.

    Attributes:
        index: Its position in its batch.
        world: ``<generation>/<world>`` in its batch.
        passed: Whether it passed; None for one that was canceled.
        reason: Why it did not pass, in one or two words; empty for one that passed.
        recording: The file that holds its recording, or empty.
    """

    index: int
    world: str
    seed: int
    environment: Mapping[str, str]
    passed: bool | None
    reason: str
    recording: str


class EpisodeFlip(Spec):
    """An episode that passed in one batch and not in the other.

    Attributes:
        world: In the second batch.
        first, second: Its positions in the batches.
        before: Why it did not pass in the first batch; empty if it did.
        after: The same of the second.
    """

    world: str
    seed: int
    environment: dict[str, str]
    first: int
    second: int
    before: str
    after: str

    @property
    def gained(self) -> bool:
        """Returns whether it passes now and did not before."""
        return not self.after


class WorldPairs(Spec):
    """The pairs of one world.

    Attributes:
        world: In the second batch.
        pairs: Episodes that both batches have in it and neither canceled.
        gains: How many of them pass now and did not before.
        losses: How many passed before and do not now.
    """

    world: str
    pairs: int
    gains: int
    losses: int


class CommonEpisodes(Spec):
    """What two batches have in common.

    Attributes:
        pairs: Episodes that both have and neither canceled.
        first_passed, second_passed: How many of them passed in each.
        first_alone, second_alone: Episodes that only one of them has.
        canceled: Episodes that both have and one canceled.
        by_world: The pairs of each world that has some.
        flips: Those that came out differently, in the order of the second batch.
        origins: What is not the same in both batches, such as ``robot_version: 1 -> 2``.
        apart: What only one of them was asked for, such as ``MAX_SPEED: 0.7 only in the second``.
    """

    pairs: int
    first_passed: int
    second_passed: int
    first_alone: int
    second_alone: int
    canceled: int
    by_world: tuple[WorldPairs, ...]
    flips: tuple[EpisodeFlip, ...]
    origins: tuple[str, ...]
    apart: tuple[str, ...] = ()

    @property
    def gains(self) -> int:
        """Returns how many pass now and did not before."""
        return sum(flip.gained for flip in self.flips)

    @property
    def losses(self) -> int:
        """Returns how many passed before and do not now."""
        return len(self.flips) - self.gains


def compare_tables(
    first: pa.Table, second: pa.Table, worlds: Mapping[str, str], others: Mapping[str, str]
) -> CommonEpisodes:
    """Returns what two batches have in common, and what came out differently.

    Args:
        first: The rows of one batch's ``results.parquet``.
        second: The rows of the other's.
        worlds: What tells the first batch's worlds apart, by ``<generation>/<world>``; worlds that it does not have are
            told apart by their names.
        others: The same of the second batch, whose worlds may be others of the same names.
    """
    columns = _distinguishing_columns(first, second)
    ours, theirs = _by_key(first, worlds, columns), _by_key(second, others, columns)
    both = [(ours[key], theirs[key]) for key in theirs if key in ours]
    counted = [(one, other) for one, other in both if one.passed is not None and other.passed is not None]
    return CommonEpisodes(
        pairs=len(counted),
        first_passed=sum(bool(one.passed) for one, _ in counted),
        second_passed=sum(bool(other.passed) for _, other in counted),
        first_alone=len(ours) - len(both),
        second_alone=len(theirs) - len(both),
        canceled=len(both) - len(counted),
        by_world=_by_world(counted),
        flips=tuple(_flip(one, other) for one, other in counted if one.passed != other.passed),
        origins=tuple(_origins(first, second)),
        apart=tuple(differences(first, second, worlds, others)),
    )


def _by_world(pairs: Sequence[tuple[ComparedEpisode, ComparedEpisode]]) -> tuple[WorldPairs, ...]:
    found: dict[str, list[tuple[bool | None, bool | None]]] = {}
    for one, other in pairs:
        found.setdefault(other.world, []).append((one.passed, other.passed))
    return tuple(
        WorldPairs(world=world, pairs=len(ends), gains=ends.count((False, True)), losses=ends.count((True, False)))
        for world, ends in found.items()
    )


def _by_key(table: pa.Table, worlds: Mapping[str, str], columns: Sequence[str]) -> dict[Hashable, ComparedEpisode]:
    rows = table.select(list(_COLUMNS)).to_pylist()
    return dict(zip(episode_keys(table, worlds, columns), map(_episode, rows), strict=True))


def _episode(row: Mapping[str, object]) -> ComparedEpisode:
    passed = cast("bool | None", row["success"])
    failure_code, outcome_reason, status = (str(row[name]) for name in ("failure_code", "outcome_reason", "status"))
    return ComparedEpisode(
        index=cast("int", row["index"]),
        world=str(row["world"]),
        seed=cast("int", row["seed"]),
        environment=dict(cast("Iterable[tuple[str, str]]", row["environment"])),
        passed=passed,
        reason="" if passed else short_reason(failure_code, outcome_reason, status),
        recording=str(row["recording"]),
    )


def _distinguishing_columns(first: pa.Table, second: pa.Table) -> list[str]:
    """Returns the columns that tell applications apart.

    Where each batch has a single robot, or a single scenario, it is what is compared, whatever its name. Where a batch
    has several versions of a scenario, or durations, they are part of what makes an episode the same, as for a gate.
    """
    columns: list[str] = []
    for kind in _LAUNCHED:
        names = [f"{kind}_{part}" for part in ("application", "package", "launch_file")]
        alone = all(len(_distinct(table, name)) == 1 for table in (first, second) for name in names)
        columns += [] if alone else names
    more = [name for name in _ASKED if any(len(_distinct(table, name)) > 1 for table in (first, second))]
    return columns + more


def _origins(first: pa.Table, second: pa.Table) -> Iterable[str]:
    for name in ("robot_application", "simulation_application", *_ORIGINS):
        one, other = _distinct(first, name), _distinct(second, name)
        if one != other:
            yield f"{name}: {', '.join(one)} -> {', '.join(other)}"


def _distinct(table: pa.Table, name: str) -> list[str]:
    return sorted({str(value)[:12] for value in table.column(name).unique().to_pylist()})


def _flip(one: ComparedEpisode, other: ComparedEpisode) -> EpisodeFlip:
    return EpisodeFlip(
        world=other.world,
        seed=other.seed,
        environment=dict(other.environment),
        first=one.index,
        second=other.index,
        before=one.reason,
        after=other.reason,
    )
