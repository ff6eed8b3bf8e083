"""Everything that the report's template shows: all numbers counted, all texts cut to their length."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import cast

from pydantic import JsonValue

from specs.base import Spec
from specs.data.outcomes import mark_of
from tasks.results.report.batch_facts import BatchFacts, Judgement, RuleAnswer
from tasks.results.report.failure_maps import WorldMap, world_maps
from tasks.results.report.rate_tables import (
    Grouped,
    JudgedRate,
    RateRow,
    RateTable,
    clip,
    family_of,
    judged_rate,
    rate_row,
    rate_table,
    reasons_text,
    scale,
    short_world,
    worst_first,
)
from tasks.results.report.report_columns import (
    NOT_SET,
    DrivenWorlds,
    Episodes,
    Failures,
    counts_by_world,
    end_rooms,
    group_episodes,
    read_coverage,
    read_episodes,
    read_failures,
    reasons,
    reasons_by_world,
    start_rooms,
    total_group,
)
from tasks.results.statistics.batch_summary import EpisodeGroup
from tasks.results.statistics.intervals import IntervalFamily, in_worlds, percent
from tasks.results.statistics.over_worlds import WorldsLikeThese, worlds_like_these
from tasks.results.statistics.room_coverage import RoomCoverage, coverage_line, coverage_warnings, goals_share

_ALARMING = frozenset({"SUSPECT", "NOT RUN"})
_NAMED = 8
_DISTANCES = (("final", "Apart at the end"), ("way", "Apart where farthest"))
# Of audits of older versions, which had no strata.
_OLD_SHARES = (("spread", "Spread over the batch"), ("failed", "Failed ones"))
_DIRECTIONS = (
    ("false_passes", "False passes", "passes fail"),
    ("false_alarms", "False alarms", "failures pass"),
    ("missed_contacts", "Missed contacts", "episodes without a contact have one"),
)


class AuditLine(Spec):
    """One of the audit's figures."""

    label: str
    text: str


class AuditView(Spec):
    """The audit's verdict, its sentence, its figures.

    Attributes:
        alarming: Whether it has to be read before the numbers are.
    """

    verdict: str
    sentence: str
    alarming: bool
    lines: tuple[AuditLine, ...]


def audit_view(audit: Mapping[str, JsonValue]) -> AuditView:
    """Returns what a report shows of an audit; figures that are not there are left out.

    Args:
        audit: As it is recorded; docs/guide/audit.md says what its fields are.
    """
    found: list[tuple[str, str]] = []
    if "compared" in audit:
        found.append(
            ("Compared", f"{audit['compared']} episodes of {audit.get('engine')} with {audit.get('reference')}")
        )
    found += [(label, _flips(share)) for name, label in _OLD_SHARES if (share := _mapping(audit, name))]
    for name, label, what in _DIRECTIONS:
        share = _mapping(audit, name)
        found += [(label, _direction(share, what))] if share.get("lanes") else []
    found += (
        [("In the whole batch", _total(total))] if (total := _mapping(audit, "total")).get("rate") is not None else []
    )
    found += [("C MuJoCo against itself", _control(audit, control))] if (control := _mapping(audit, "control")) else []
    found += [(label, _metres(each)) for name, label in _DISTANCES if (each := _mapping(audit, name))]
    found += [(label, _listing(texts)) for label, texts in _episodes(audit) if texts]
    return AuditView(
        verdict=str(audit.get("verdict", "")),
        sentence=str(audit.get("sentence", "")),
        alarming=audit.get("verdict") in _ALARMING,
        lines=tuple(AuditLine(label=label, text=text) for label, text in found),
    )


def _episodes(audit: Mapping[str, JsonValue]) -> list[tuple[str, list[str]]]:
    """Returns the episodes that the audit names, with what it names them for."""
    flips, others = (cast("Sequence[Mapping[str, JsonValue]]", audit.get(name) or ()) for name in ("flips", "others"))
    not_again, unlocked = (cast("Sequence[JsonValue]", audit.get(name) or ()) for name in ("unreproduced", "unlocked"))
    return [
        ("Came to another end", [_flip(each) for each in flips]),
        ("Ended otherwise, with the same success", [_flip(each) for each in others]),
        ("Could not be made again", [f"job {index}" for index in not_again]),
        ("Lock-step did not hold", [f"job {index}" for index in unlocked]),
    ]


def _listing(texts: Sequence[str]) -> str:
    more = f", and {len(texts) - _NAMED} more" if len(texts) > _NAMED else ""
    return "; ".join(texts[:_NAMED]) + more


def _mapping(audit: Mapping[str, JsonValue], name: str) -> Mapping[str, JsonValue]:
    found = audit.get(name)
    return found if isinstance(found, dict) else {}


def _flips(share: Mapping[str, JsonValue]) -> str:
    return f"{share.get('flips')} of {share.get('lanes')} came to another end"


def _flip(each: Mapping[str, JsonValue]) -> str:
    chaotic = " (C MuJoCo itself flips it)" if each.get("chaotic") else ""
    return f"job {each['index']}: {each['row']}, not {each['reference']}{chaotic}"


def _direction(share: Mapping[str, JsonValue], what: str) -> str:
    return f"{share['flips']} of {share['lanes']} {what} on C MuJoCo ({_rate(share)})"


def _total(total: Mapping[str, JsonValue]) -> str:
    return f"success is another one on C MuJoCo in {_rate(total)}"


def _control(audit: Mapping[str, JsonValue], control: Mapping[str, JsonValue]) -> str:
    """Returns what C MuJoCo, started a micrometre beside, differs from itself, and what of the flips that explains."""
    said = [f"two of its drives, a micrometre apart, differ in success in {_rate(control)}"]
    flips = cast("Sequence[Mapping[str, JsonValue]]", audit.get("flips") or ())
    if flips:
        chaotic = sum(bool(each.get("chaotic")) for each in flips)
        said.append(f"{chaotic} of {len(flips)} flips are of lanes that it flips itself")
    for name, label, _ in _DIRECTIONS:
        share = _mapping(audit, name)
        if share.get("flips") and share.get("chance") is not None:
            chance = cast("float", share["chance"])
            said.append(f"an engine as good as it has so many {label.lower()} in {100 * chance:.1f} % of such audits")
    return "; ".join(said)


def _rate(each: Mapping[str, JsonValue]) -> str:
    rate, lower, upper = (cast("float", each[name]) for name in ("rate", "lower", "upper"))
    return f"{100 * rate:.1f} %, 95 % interval {100 * lower:.1f} to {100 * upper:.1f} %"


def _metres(each: Mapping[str, JsonValue]) -> str:
    figures = [(name, cast("float", each.get(f"{name}_m"))) for name in ("median", "p90", "max")]
    return ", ".join(f"{name} {value:.2g} m" for name, value in figures if value is not None)  # pyright: ignore[reportUnnecessaryComparison] - JSON


_CONFIDENCE = 0.95
_LONGEST = 240


class ReasonRow(Spec):
    """Why episodes did not pass.

    Attributes:
        share: Of all failures.
        width: Length of a bar, the most frequent reason being 100 %.
        sample: What the first of them said of itself, or empty.
    """

    reason: str
    mark: str
    count: int
    share: str
    width: str
    sample: str


class StageRow(Spec):
    """A stage's time; ``width`` is the length of a bar, the slowest being 100 %."""

    name: str
    seconds: str
    width: str
    summary: str


class RoomsView(Spec):
    """The rooms that robots were in.

    Attributes:
        line: In words.
        warnings: What keeps the verdict from being about the whole of its worlds.
        coverage: In numbers.
        goals_share: The share of goals that a robot could get to; empty where goals are no destinations.
    """

    line: str
    warnings: tuple[str, ...]
    coverage: RoomCoverage
    goals_share: str


class ReportView(Spec):
    """All that the template shows.

    Attributes:
        facts: What is shown as it is.
        sentence: The gate's, without the verdict before it; of several rules, how many say what.
        rules: Each with its sentence, likewise, where there are several.
        whole: All episodes as a line.
        judged: The rate that was judged, or that of all episodes, on the axis of the verdict.
        like_these: What the episodes that were judged say of worlds that were not drawn.
        where: In which worlds the rate of all episodes holds.
        family: How many intervals of groups there are, and how sure all of them together are.
        misses: How many of them miss in the mean, if each holds by itself.
        columns: Tables of rates, in the columns of a wide page.
        rooms: How much of its worlds the robots were in; None where the tables do not say.
        audit: None where none was made.
        stages: The slowest first.
    """

    facts: BatchFacts
    title: str
    created: str
    sentence: str
    rules: tuple[RuleAnswer, ...]
    confidence: str
    total: EpisodeGroup
    whole: RateRow
    judged: JudgedRate
    like_these: WorldsLikeThese
    where: str
    reasons: tuple[ReasonRow, ...]
    family: IntervalFamily
    misses: str
    columns: tuple[tuple[RateTable, ...], ...]
    maps: tuple[WorldMap, ...]
    worlds: int
    failures: int
    simulated: str
    rooms: RoomsView | None
    audit: AuditView | None
    stages: tuple[StageRow, ...]


def report_view(facts: BatchFacts, results: Path, failures: Path, worlds: DrivenWorlds) -> ReportView:
    """Returns what a report shows.

    Args:
        facts: The batch.
        results: Its ``results.parquet``, a local file.
        failures: Its ``failures.parquet``, likewise.
        worlds: Its worlds.
    """
    swept = [name for name, values in facts.variables.items() if len(values) > 1]
    episodes, failed = read_episodes(results, swept), read_failures(failures)
    judgement = facts.judgement
    confidence = judgement.confidence if judgement else _CONFIDENCE
    goal = judgement.at_least if judgement else None
    total = total_group(episodes, confidence, facts.looks)
    groups = _groups(facts, episodes, failed, worlds, confidence)
    family, like_these = family_of(groups, confidence, facts.looks), _like_these(episodes, facts, confidence)
    return ReportView(
        facts=facts,
        title=facts.name or facts.batch,
        created=f"{datetime.fromtimestamp(facts.created_at_s, tz=UTC):%Y-%m-%d %H:%M} UTC",
        sentence=_sentence(judgement) if judgement else "",
        rules=_rules(judgement) if judgement else (),
        confidence=f"{100 * confidence:g}\u00a0%",
        total=total,
        whole=rate_row(total, scale([total.interval.lower], None), total.label, None),
        judged=judged_rate(total, facts, confidence, like_these.spread.worlds),
        like_these=like_these,
        where=in_worlds(sum(map(bool, counts_by_world(episodes)[1]))),
        reasons=_reasons(failed),
        family=family,
        misses=f"{family.size * (1.0 - confidence):.2g}",
        columns=_columns([rate_table(each, family, goal) for each in groups]),
        maps=tuple(world_maps(facts, episodes, failed, failures, worlds)),
        worlds=len(facts.worlds),
        failures=failed.table.num_rows,
        simulated=_duration(facts.simulated_s),
        rooms=_rooms(read_coverage(results)),
        audit=audit_view(facts.audit) if facts.audit else None,
        stages=_stages(facts),
    )


def _like_these(episodes: Episodes, facts: BatchFacts, confidence: float) -> WorldsLikeThese:
    early = "the batch might have ended early" if facts.looks else ""
    counts = counts_by_world(episodes, facts.judgement.digests if facts.judgement else ())
    return worlds_like_these(*counts, confidence, refused=early)


def _sentence(judgement: Judgement) -> str:
    if len(judgement.rules) < 2:
        return judgement.sentence.removeprefix(f"{judgement.verdict}: ")
    answers = [rule.verdict for rule in judgement.rules]
    said = [
        f"{answers.count(answer)} say{'s' * (answers.count(answer) == 1)} {answer}"
        for answer in ("FAIL", "INCONCLUSIVE", "PASS")
        if answer in answers
    ]
    return f"Of {len(answers)} rules, {', '.join(said)}."


def _rules(judgement: Judgement) -> tuple[RuleAnswer, ...]:
    if len(judgement.rules) < 2:
        return ()
    return tuple(
        rule.model_copy(update={"sentence": rule.sentence.removeprefix(f"{rule.verdict}: ")})
        for rule in judgement.rules
    )


def _groups(
    facts: BatchFacts, episodes: Episodes, failed: Failures, worlds: DrivenWorlds, confidence: float
) -> tuple[Grouped, ...]:
    why = {world: reasons_text(found) for world, found in reasons_by_world(failed).items()}
    by_world = worst_first(group_episodes(episodes, episodes.world, confidence, facts.looks))
    here = in_worlds(sum(bool(group.episodes) for group in by_world))
    found = [Grouped("By world", "each in that world alone", "World", by_world, why, short_world(tuple(facts.worlds)))]
    if len(episodes.application.names) > 1:
        by_application = group_episodes(episodes, episodes.application, confidence, facts.looks)
        found.append(Grouped("By application", here, "Robot and scenario", by_application))
    for name, labels in episodes.variables.items():
        groups = _in_document_order(group_episodes(episodes, labels, confidence, facts.looks), facts.variables[name])
        found.append(Grouped(f"By {clip(name, 60)}", here, "Value", groups))
    if worlds.rooms:
        for caption, place in (("By room of the start", start_rooms), ("By room of the end", end_rooms)):
            groups = worst_first(group_episodes(episodes, place(episodes, worlds), confidence, facts.looks))
            if len(groups) > 1:  # one room type says what all episodes say
                found.append(Grouped(caption, here, "Room type", groups))
    return tuple(found)


def _columns(tables: Sequence[RateTable]) -> tuple[tuple[RateTable, ...], ...]:
    """Returns the tables in two columns of about the same height, in their order."""
    lines = [2.5 + sum(1.5 if row.why else 1.0 for row in table.rows) for table in tables]
    cuts = range(1, len(tables) + 1)
    cut = min(cuts, key=lambda cut: max(sum(lines[:cut]), sum(lines[cut:])))
    return tuple(tuple(column) for column in (tables[:cut], tables[cut:]) if column)


def _in_document_order(groups: Sequence[EpisodeGroup], values: Sequence[str | None]) -> list[EpisodeGroup]:
    order = {NOT_SET if value is None else value: position for position, value in enumerate(values)}
    return sorted(groups, key=lambda group: order.get(group.label, len(order)))


def _reasons(failed: Failures) -> tuple[ReasonRow, ...]:
    found, all_of_them = reasons(failed), failed.table.num_rows
    samples = _samples(failed)
    return tuple(
        ReasonRow(
            reason=reason,
            mark=mark_of(reason).name,
            count=count,
            share=percent(count / all_of_them),
            width=f"{100 * count / found[0][1]:.2f}%",
            sample=clip(samples.get(reason, ""), _LONGEST),
        )
        for reason, count in found
    )


def _samples(failed: Failures) -> dict[str, str]:
    """Returns what the first failure of each reason said of itself, if it said something."""
    firsts: dict[int, int] = {}
    for row, code in enumerate(failed.reason.codes.tolist()):
        firsts.setdefault(code, row)
    return {failure.reason: failure.failure_reason for failure in failed.read_rows(list(firsts.values()))}


def _rooms(found: RoomCoverage | None) -> RoomsView | None:
    if found is None:
        return None
    return RoomsView(
        line=coverage_line(found),
        warnings=tuple(coverage_warnings(found)),
        coverage=found,
        goals_share=goals_share(found) if found.goals else "",
    )


def _stages(facts: BatchFacts) -> tuple[StageRow, ...]:
    slowest = sorted(facts.stages, key=lambda stage: (-stage.seconds, stage.name))
    longest_s = slowest[0].seconds if slowest else 1.0
    return tuple(
        StageRow(
            name=stage.name,
            seconds=f"{stage.seconds:.1f} s",
            width=f"{100 * stage.seconds / (longest_s or 1.0):.2f}%",
            summary=clip(stage.summary, _LONGEST),
        )
        for stage in slowest
    )


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60)
    return (
        f"{minutes // 60} h {minutes % 60} min"
        if minutes >= 60
        else f"{minutes} min"
        if minutes
        else f"{seconds:.0f} s"
    )
