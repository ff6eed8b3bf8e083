"""Everything that the report's template shows: all numbers counted, all texts cut to their length."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from specs.base import Spec, canonical_document, canonical_json
from specs.data.outcomes import mark_of
from specs.data.parity_audit import ApartQuantiles, AuditControl, AuditReport, Flip, FlipShare, TotalShare
from specs.data.world import Room
from tasks.results.report.batch_facts import BatchFacts, Judgement, RuleAnswer
from tasks.results.report.cause_view import CausesView, causes_view
from tasks.results.report.failure_maps import WorldMap, world_maps
from tasks.results.report.last_pictures import LastSeen, no_pictures
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
    read_people,
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


def audit_view(audit: AuditReport) -> AuditView:
    """Returns what a report shows of an audit; figures that are not there are left out."""
    found: list[tuple[str, str]] = []
    if audit.compared:
        found.append(("Compared", f"{audit.compared} episodes of {audit.engine} with {audit.reference}"))
    for share, label, what in _directions(audit):
        if share.lanes:
            found.append((label, f"{share.text()} {what} on C MuJoCo ({_rate(share)})"))
    if audit.total.rate is not None:
        found.append(("In the whole batch", f"success is another one on C MuJoCo in {_rate(audit.total)}"))
    if audit.control:
        found.append(("C MuJoCo against itself", _control(audit, audit.control)))
    distances = ((audit.final, "Apart at the end"), (audit.way, "Apart where farthest"))
    found += [(label, _metres(apart)) for apart, label in distances if apart]
    found += [(label, _listing(texts)) for label, texts in _episodes(audit) if texts]
    return AuditView(
        verdict=audit.verdict,
        sentence=audit.sentence,
        alarming=audit.verdict in _ALARMING,
        lines=tuple(AuditLine(label=label, text=text) for label, text in found),
    )


def _directions(audit: AuditReport) -> tuple[tuple[FlipShare, str, str], ...]:
    return (
        (audit.false_passes, "False passes", "passes fail"),
        (audit.false_alarms, "False alarms", "failures pass"),
        (audit.missed_contacts, "Missed contacts", "episodes without a contact have one"),
    )


def _episodes(audit: AuditReport) -> list[tuple[str, list[str]]]:
    """Returns the episodes that the audit names, with what it names them for."""
    return [
        ("Came to another end", [_flip(each) for each in audit.flips]),
        ("Ended otherwise, with the same success", [_flip(each) for each in audit.others]),
        ("Could not be made again", [f"job {index}" for index in audit.unreproduced]),
        ("Lock-step did not hold", [f"job {index}" for index in audit.unlocked]),
    ]


def _listing(texts: Sequence[str]) -> str:
    more = f", and {len(texts) - _NAMED} more" if len(texts) > _NAMED else ""
    return "; ".join(texts[:_NAMED]) + more


def _flip(each: Flip) -> str:
    chaotic = " (C MuJoCo itself flips it)" if each.chaotic else ""
    return f"job {each.index}: {each.row}, not {each.reference}{chaotic}"


def _control(audit: AuditReport, control: AuditControl) -> str:
    """Returns what C MuJoCo, started a micrometre beside, differs from itself, and what of the flips that explains."""
    said = [f"two of its drives, a micrometre apart, differ in success in {_rate(control)}"]
    if audit.flips:
        chaotic = sum(bool(each.chaotic) for each in audit.flips)
        said.append(f"{chaotic} of {len(audit.flips)} flips are of lanes that it flips itself")
    for share, label, _ in _directions(audit):
        if share.flips and share.chance is not None:
            likely = f"in {100 * share.chance:.1f} % of such audits"
            said.append(f"an engine as good as it has so many {label.lower()} {likely}")
    return "; ".join(said)


def _rate(each: FlipShare | TotalShare | AuditControl) -> str:
    return f"{100 * (each.rate or 0.0):.1f} %, 95 % interval {100 * each.lower:.1f} to {100 * each.upper:.1f} %"


def _metres(apart: ApartQuantiles) -> str:
    return f"median {apart.median_m:.2g} m, p90 {apart.p90_m:.2g} m, max {apart.max_m:.2g} m"


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


class FoundRow(Spec):
    """A failure that a search found.

    Attributes:
        number: As the command that drives it again has it.
        reason: Why it failed.
        mark: Of the reason.
        circumstances: Where, and with which variables.
        on_reference: What C MuJoCo says, or the replay if that says something else.
        alike: How many of the failures that were found are nearest to it.
        replay: The command that drives it again.
    """

    number: int
    reason: str
    mark: str
    circumstances: str
    on_reference: str
    alike: int
    replay: str


class SearchView(Spec):
    """What a search found.

    Attributes:
        sentence: How probable a failure is, and how that was found.
        over: What was varied, a line each.
        findings: How many episodes failed, and how many of them are reported.
        rows: Failures that fail again, unlike each other.
        vanished: Those that did not fail again.
        causes: What failures have in common.
    """

    sentence: str
    over: tuple[str, ...]
    causes: CausesView
    findings: str
    rows: tuple[FoundRow, ...]
    vanished: tuple[FoundRow, ...]


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
        people: How many people walked in each world, or empty where nobody did.
        rooms: How much of its worlds the robots were in; None where the tables do not say.
        audit: None where none was made.
        search: None where nothing was searched for.
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
    people: str
    rooms: RoomsView | None
    audit: AuditView | None
    search: SearchView | None
    stages: tuple[StageRow, ...]


def report_view(
    facts: BatchFacts, results: Path, failures: Path, worlds: DrivenWorlds, seen: LastSeen = no_pictures
) -> ReportView:
    """Returns what a report shows.

    Args:
        facts: The batch.
        results: Its ``results.parquet``, a local file.
        failures: Its ``failures.parquet``, likewise.
        worlds: Its worlds.
        seen: Finds what robots saw last in episodes that failed.
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
        maps=tuple(world_maps(facts, episodes, failed, failures, worlds, seen=seen)),
        worlds=len(facts.worlds),
        failures=failed.table.num_rows,
        simulated=_duration(facts.simulated_s),
        people=_people(read_people(results)),
        rooms=_rooms(read_coverage(results)),
        audit=audit_view(facts.audit) if facts.audit else None,
        search=_search(facts),
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
    short, alone = short_world(tuple(facts.worlds)), "each in that world alone"
    found = [Grouped("By world", alone, "World", by_world, why, short, folds=True)]
    if len(episodes.application.names) > 1:
        by_application = group_episodes(episodes, episodes.application, confidence, facts.looks)
        found.append(Grouped("By application", here, "Robot and scenario", by_application))
    for name, labels in episodes.variables.items():
        groups = _in_document_order(group_episodes(episodes, labels, confidence, facts.looks), facts.variables[name])
        found.append(Grouped(f"By {clip(name, 60)}", here, "Value", groups))
    if worlds.rooms:
        typed = any(isinstance(room, Room) for rooms in worlds.rooms.values() for room in rooms)
        for caption, place in (("By room of the start", start_rooms), ("By room of the end", end_rooms)):
            groups = worst_first(group_episodes(episodes, place(episodes, worlds), confidence, facts.looks))
            if len(groups) > 1:  # one room type says what all episodes say
                found.append(Grouped(caption, here, "Room type" if typed else "Room", groups, label=_short))
    return tuple(found)


def _short(name: str) -> str:
    return clip(name, 60)


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


def _people(counts: Sequence[int]) -> str:
    return f"{' or '.join(map(str, counts))} in each world" if any(counts) else ""


def _search(facts: BatchFacts) -> SearchView | None:
    if (found := facts.search) is None:
        return None
    rows = tuple(
        FoundRow(
            number=number,
            reason=each.reason,
            mark=mark_of(each.reason).name,
            circumstances=each.circumstances,
            on_reference=each.on_reference,
            alike=each.alike,
            replay=f"simyard replay {facts.arn} --found {number}",
        )
        for number, each in enumerate(found.numbered, 1)
    )
    over = found.search.over.items()
    return SearchView(
        sentence=found.probability.sentence,
        over=tuple(f"{name}: {canonical_json(canonical_document(each)).decode()}" for name, each in over),
        findings=found.findings,
        rows=rows[: len(found.failures)],
        vanished=rows[len(found.failures) :],
        causes=causes_view(found.causes),
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
