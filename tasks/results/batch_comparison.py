"""Compares the tables of two batches: the episodes that both have, and whether the second batch is no worse.

Episodes are the same if world, seed, environment and applications are; versions of applications are what is compared.
`differences` names what only one batch asked of its episodes, so that they have fewer of them in common. Two versions
in one table would be paired with those of another table by their turn, whatever they are. So a table that is compared
holds one version of each application. Versions are the same if their bundles are.
"""

from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import starmap
from typing import Literal, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import pyarrow as pa
from jaxtyping import Float

from specs.base import Spec
from specs.data.episode import short_reason
from tasks.results.gate.version_pairs import episode_keys
from tasks.results.playback.plan_drawings import PlanPage, draw_over, plan_page
from tasks.results.statistics.intervals import Interval, in_worlds, mcnemar, paired_difference
from tasks.results.statistics.over_worlds import difference_over_worlds, why_refused

_SHORTEST_DIGEST, _SHOWN = 8, 12


def versions_driven(rows: pa.Table) -> dict[str, dict[str, str]]:
    """Returns the version that each bundle was asked for as, by its digest, for each robot application."""
    found: dict[str, dict[str, str]] = {}
    columns = rows.select(["robot_application", "robot_digest", "robot_version"])
    for row in columns.group_by(columns.column_names).aggregate([]).to_pylist():
        found.setdefault(row["robot_application"], {})[row["robot_digest"]] = row["robot_version"]
    return found


def ambiguous_versions(driven: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Returns how to name each version of the applications of which there are several; none if all have one.

    A number names a version, unless several of its builds were driven: then the beginning of a digest does.
    """
    names: list[str] = []
    for versions in driven.values():
        labels = list(versions.values())
        if len(versions) > 1:
            names += [
                label if labels.count(label) == 1 else digest[:_SHOWN] for digest, label in sorted(versions.items())
            ]
    return sorted(dict.fromkeys(names))


def version_rows(rows: pa.Table, version: str, digests: Collection[str]) -> pa.Table:
    """Returns the rows of one version; none if the batch did not drive it.

    Args:
        rows: Of a batch.
        version: As the batch asked for it, or the beginning of a digest of at least eight digits.
        digests: Of the bundles that the version's number stands for in the store.
    """
    driven = {digest: label for found in versions_driven(rows).values() for digest, label in found.items()}
    meant = [digest for digest, label in driven.items() if label == version or digest in digests]
    if not meant and len(version) >= _SHORTEST_DIGEST:
        meant = [digest for digest in driven if digest.startswith(version)]
    chosen = set(meant)
    return rows.filter(pa.array([digest in chosen for digest in rows.column("robot_digest").to_pylist()], pa.bool_()))


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
    alone = [([value for value in mine if value not in theirs], which) for mine, theirs, which in sides]
    said = [f"{len(own) if counted else _listing(own)} only in {which}" for own, which in alone if own]
    if said:
        yield f"{name}: {'; '.join(said)}"


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


class ComparedWorld(Spec):
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
    by_world: tuple[ComparedWorld, ...]
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


def _by_world(pairs: Sequence[tuple[ComparedEpisode, ComparedEpisode]]) -> tuple[ComparedWorld, ...]:
    found: dict[str, list[tuple[bool | None, bool | None]]] = {}
    for one, other in pairs:
        found.setdefault(other.world, []).append((one.passed, other.passed))
    return tuple(
        ComparedWorld(world=world, pairs=len(ends), gains=ends.count((False, True)), losses=ends.count((True, False)))
        for world, ends in found.items()
    )


def _by_key(table: pa.Table, worlds: Mapping[str, str], columns: Sequence[str]) -> dict[Hashable, ComparedEpisode]:
    rows = zip(*(table.column(name).to_pylist() for name in _COLUMNS), strict=True)
    return dict(zip(episode_keys(table, worlds, columns), starmap(_episode, rows), strict=True))


def _episode(  # noqa: PLR0917 - the columns of a row, in their order
    index: int,
    world: str,
    seed: int,
    environment: Iterable[tuple[str, str]],
    success: bool | None,  # noqa: FBT001
    status: str,
    failure_code: str,
    outcome_reason: str,
    recording: str,
) -> ComparedEpisode:
    reason = "" if success else short_reason(failure_code, outcome_reason, status)
    return ComparedEpisode(index, world, seed, dict(environment), success, reason, recording)


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


ComparisonAnswer = Literal["NO WORSE", "WORSE", "INCONCLUSIVE"]


class Comparison(Spec):
    """What two batches show about each other.

    Attributes:
        difference: Success rate of the second batch less that of the first, over the episodes that both have.
        interval: Of the difference in these worlds (Tango 1998).
        over_worlds: Of the difference in worlds like these; None where nothing is said of it.
        refused: Why nothing is said of it; else empty.
        p_value: Of McNemar's exact test: how likely flips as uneven as these are, were both equally good.
        margin: How much lower the second rate may be.
        answer: NO WORSE if the whole interval is above -margin, WORSE if it is below, else INCONCLUSIVE; in these
            worlds.
        answer_over_worlds: The same of worlds like these; None where nothing is said of them.
    """

    first: str
    second: str
    pairs: CommonEpisodes
    difference: float
    interval: Interval
    over_worlds: Interval | None
    refused: str
    confidence: float
    p_value: float
    margin: float
    answer: ComparisonAnswer
    answer_over_worlds: ComparisonAnswer | None

    def where(self) -> str:
        """Returns in which worlds the rates, the difference and the answer hold, in words."""
        return in_worlds(len(self.pairs.by_world))

    def elsewhere(self) -> str:
        """Returns the other worlds that they may be asked of, in words: those like these."""
        return in_worlds(len(self.pairs.by_world), like_these=True)


def comparison(first: str, second: str, pairs: CommonEpisodes, *, margin: float, confidence: float) -> Comparison:
    """Returns what pairs of episodes show.

    Args:
        first: One batch.
        second: The other, which must be no worse.
        pairs: At least one.
        margin: How much lower its success rate may be, 0 to 1.
        confidence: Coverage of the interval, between 0 and 1.
    """
    interval = paired_difference(pairs.gains, pairs.losses, pairs.pairs, confidence)
    counts = [(each.gains, each.losses, each.pairs) for each in pairs.by_world]
    refused = why_refused("difference", len(counts))
    gains, losses, n = ([each[at] for each in counts] for at in range(3))
    over_worlds = None if refused else difference_over_worlds(gains, losses, n, confidence)
    return Comparison(
        first=first,
        second=second,
        pairs=pairs,
        difference=(pairs.gains - pairs.losses) / pairs.pairs,
        interval=interval,
        over_worlds=over_worlds,
        refused=refused,
        confidence=confidence,
        p_value=mcnemar(pairs.gains, pairs.losses),
        margin=margin,
        answer=_answer(interval, margin),
        answer_over_worlds=_answer(over_worlds, margin) if over_worlds else None,
    )


def _answer(interval: Interval, margin: float) -> ComparisonAnswer:
    if interval.lower > -margin:
        return "NO WORSE"
    return "WORSE" if interval.upper < -margin else "INCONCLUSIVE"


def comparison_notes(found: Comparison) -> list[str]:
    """Returns what was compared, and what not."""
    pairs = found.pairs
    lines = [f"not the same: {origin}" for origin in pairs.origins]
    lines += [f"not asked of both: {each}" for each in pairs.apart]
    if pairs.first_alone or pairs.second_alone or pairs.canceled:
        lines.append(
            f"left out: episodes of the first batch alone {pairs.first_alone}, of the second alone "
            f"{pairs.second_alone}, canceled {pairs.canceled}"
        )
    return lines


def comparison_warning(found: Comparison) -> str:
    """Returns a warning where each batch has episodes that the other has not: what changed may not be compared."""
    pairs = found.pairs
    if not (pairs.first_alone and pairs.second_alone):
        return ""
    both = pairs.pairs + pairs.canceled
    return (
        f"WARNING: {pairs.first_alone} of {both + pairs.first_alone} episodes of the first batch and "
        f"{pairs.second_alone} of {both + pairs.second_alone} of the second are not compared, and the answer says "
        f"nothing about them: {'; '.join(pairs.apart) or 'their worlds, seeds and variables go together otherwise'}"
    )


def comparison_answer(found: Comparison) -> str:
    """Returns the answer and its figures in one sentence, and what holds of other worlds."""
    low, high = found.interval.lower, found.interval.upper
    return (
        f"{found.answer}: {found.pairs.gains} gained and {found.pairs.losses} lost of {found.pairs.pairs} pairs; "
        f"difference {found.difference:+.3f} ({low:+.3f} to {high:+.3f}) {found.where()}, margin {found.margin:g}, "
        f"McNemar p = {found.p_value:.3g}; {other_worlds(found)}"
    )


def other_worlds(found: Comparison) -> str:
    """Returns what holds in worlds like these, with the answer that it gives; or why nothing is said of them."""
    if found.over_worlds is None or found.answer_over_worlds is None:
        return f"{found.elsewhere()} nothing is said: {found.refused}"
    low, high = found.over_worlds.lower, found.over_worlds.upper
    also = "too" if found.answer_over_worlds == found.answer else f"the answer would be {found.answer_over_worlds}"
    return f"{found.elsewhere()} {also} ({low:+.3f} to {high:+.3f})"


_STYLE = """
.flips{fill:none;stroke-linejoin:round;stroke-linecap:round;stroke-width:2.6}
.flips .first{stroke:#0072b2;stroke-dasharray:7 5}.flips .second{stroke:#d55e00}
.flips .lost{stroke-width:3}.flips text{stroke:none;fill:#23272b;font-size:12px;text-anchor:end}
.flips g:hover>.first,.flips g:hover>.second{stroke-width:5}
"""
_PASSED = "passed"


class FlipPaths(NamedTuple):
    """A flip and the ways that the robot took; None where one is not known."""

    flip: EpisodeFlip
    first_m: Float[np.ndarray, "samples 2"] | None
    second_m: Float[np.ndarray, "samples 2"] | None


def flip_map_svg(plan: str, ways: Sequence[FlipPaths]) -> str:
    """Returns the plan with both ways of each flip, a ring where one passed, a cross where it did not.

    Args:
        plan: A floor plan as the export draws it.
        ways: Flips in that world.

    Raises:
        ValueError: The plan does not say its scale.
    """
    page = plan_page(plan)
    root = ET.Element("g", {"class": "flips"})
    ET.SubElement(root, "style").text = _STYLE
    for each in ways:
        group = ET.SubElement(root, "g")
        ET.SubElement(group, "title").text = flip_text(each.flip)
        for name, way_m, why in (("first", each.first_m, each.flip.before), ("second", each.second_m, each.flip.after)):
            if way_m is not None and len(way_m):
                _way(group, page, name, way_m, why)
    _legend(root, page)
    return draw_over(plan, root)


def flip_text(flip: EpisodeFlip) -> str:
    """Returns a flip in one line: which episode, and how it came out before and after."""
    values = "".join(f" {name}={value}" for name, value in sorted(flip.environment.items()))
    return (
        f"{flip.world} seed {flip.seed}{values} ({flip.first} -> {flip.second}): "
        f"{flip.before or _PASSED} -> {flip.after or _PASSED}"
    )


def _way(parent: ET.Element, page: PlanPage, name: str, way_m: Float[np.ndarray, "samples 2"], why: str) -> None:
    points = [page.at(point) for point in way_m]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    ET.SubElement(parent, "polyline", {"class": name, "points": line})
    x, y = points[-1]
    if why:
        ET.SubElement(parent, "path", {"class": f"{name} lost", "d": f"M{x:.1f} {y:.1f}m-6 -6l12 12m0 -12l-12 12"})
    else:
        ET.SubElement(parent, "circle", {"class": name, "cx": f"{x:.1f}", "cy": f"{y:.1f}", "r": "6"})


def _legend(root: ET.Element, page: PlanPage) -> None:
    for line, (name, text) in enumerate((("first", "first batch"), ("second", "second batch"))):
        y, right = 48 + 18 * line, page.width - 64
        ET.SubElement(root, "text", {"x": f"{right - 44:.0f}", "y": f"{y}"}).text = text
        ET.SubElement(root, "path", {"class": name, "d": f"M{right - 36:.0f} {y - 4}h36"})
