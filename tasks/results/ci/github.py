"""A run, or a comparison of two batches, as GitHub shows it: summary of a step, comment, annotations.

All that a stranger may have written (names of worlds, reasons, sentences with them) stands in code: GitHub makes links
and mentions of what is escaped as well. A page has as many blocks as it may have bytes. Annotations are workflow
commands, such as ``::error title=...::...``, a line each; GitHub shows ten errors and ten warnings of a step, and drops
others without a word.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

from specs.untrusted_text import code_span, terminal_line
from tasks.results.batch_comparison import Comparison, ComparisonAnswer, EpisodeFlip, other_worlds
from tasks.results.ci.full_report import Answer, CountedBatch, FullReport, WorldReport
from tasks.results.gate.rules.rule import RuleVerdict
from tasks.results.statistics.intervals import percent, percent_range, wilson

_REST = "_The rest is left out: it would be longer than the page may be._"


def bounded_page(blocks: Iterable[str], most_bytes: int) -> str:
    """Returns blocks with empty lines between them; from the first that has no room, a sentence instead.

    No block is cut, so that none ends in the middle of a table or of code.

    Args:
        blocks: Each Markdown that can stand alone; empty ones are left out.
        most_bytes: In UTF-8, which no characters exceed either.
    """
    page, room = "", most_bytes - len(f"{_REST}\n".encode())
    for block in filter(None, blocks):
        more = f"{block}\n\n"
        if len(page.encode()) + len(more.encode()) > room:
            return f"{page}{_REST}\n" if room > 0 else ""
        page += more
    return page


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Returns a table; its cells are Markdown already. Empty if it has no rows."""
    lines = [_line(row) for row in rows]
    return "\n".join([_line(head), _line(["---"] * len(head)), *lines]) if lines else ""


def details(summary: str, body: str) -> str:
    """Returns a part of a page that is folded until somebody opens it; empty if there is nothing in it."""
    return f"<details><summary>{summary}</summary>\n\n{body}\n\n</details>" if body else ""


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


SUMMARY_BYTES = 1 << 20
"""GitHub takes no longer summary of a step."""
_MOST_WORLDS = 100
_MOST_FAILURES = 50
_VERDICT_SIGNS: Mapping[str, str] = {"PASS": "✅", "FAIL": "❌", "INCONCLUSIVE": "❔"}
_ANSWERS: Mapping[Answer, str] = {
    "PASSED": "✅ Passed",
    "NOT PASSED": "❌ Not passed",
    "INCONCLUSIVE": "❔ INCONCLUSIVE",
    "FAILED": "💥 A stage failed",
    "REFUSED": "🚫 The document is refused",
}


def summary_markdown(report: FullReport, most_bytes: int = SUMMARY_BYTES) -> str:
    """Returns the summary of a run, no longer than that many bytes.

    Args:
        report: The run.
        most_bytes: In UTF-8.
    """
    return bounded_page(_summary_blocks(report), most_bytes)


def _summary_blocks(report: FullReport) -> Iterator[str]:
    yield f"## {_ANSWERS[report.answer]}: {code_span(report.document)}"
    yield _why(report)
    if report.gate:
        yield table(("rule", "answer", "seen", "interval", "counted", "why"), map(_rule_row, report.gate.rules))
    yield from (f"- ⚠️ {code_span(problem, 1_000)}" for problem in _alarms(report))
    if report.batch:
        yield from _batch_blocks(report.batch)
    yield details("Stages and files", "\n\n".join(_stages(report)))


def _why(report: FullReport) -> str:
    if report.failure:
        faults = [f"- {code_span(str(fault), 500)}" for fault in report.failure.faults[:40]]
        return "\n".join([f"{code_span(report.failure.code)}: {code_span(report.failure.reason, 1_000)}\n", *faults])
    if report.gate:
        return code_span(report.gate.sentence.splitlines()[0], 1_000)
    return "No gate was asked for, so nobody judged the batch." if report.batch else ""


def _alarms(report: FullReport) -> list[str]:
    alarms = [str(stage.facts["alarm"]) for stage in report.stages if "alarm" in stage.facts]
    return [*alarms, *report.problems]


def _rule_row(rule: RuleVerdict) -> tuple[str, ...]:
    counted = f"{rule.counted:,}" if rule.counted else ""
    seen = "" if rule.estimate is None else f"{rule.estimate:.3f}"
    answer = f"{_VERDICT_SIGNS[rule.verdict]} {rule.verdict}"
    return code_span(rule.title), answer, seen, _bounds(rule), counted, code_span(rule.sentence)


def _bounds(rule: RuleVerdict) -> str:
    if rule.lower is None and rule.upper is None:
        return ""
    low, high = ("" if bound is None else f"{bound:.3f}" for bound in (rule.lower, rule.upper))
    return f"{low} to {high} ({rule.method})"


def _batch_blocks(batch: CountedBatch) -> Iterator[str]:
    yield f"### Episodes\n\n{_counts(batch)}"
    worlds = sorted(batch.worlds, key=_world_rate)
    why = ("world", "passed", "rate", "why not")
    rates = table(why, map(_world_row, worlds[:_MOST_WORLDS]))
    more = f"\n\n{len(worlds) - _MOST_WORLDS} worlds more." if len(worlds) > _MOST_WORLDS else ""
    yield (
        details(f"Rates of {len(batch.worlds)} worlds, the lowest first, each in that world alone", rates + more)
        if rates
        else ""
    )
    yield from _failure_blocks(batch, worlds)


def _counts(batch: CountedBatch) -> str:
    rate = "" if batch.rate is None else f": {percent(batch.rate)}"
    canceled = f"; {batch.canceled:,} canceled" if batch.canceled else ""
    sure = f"{100 * batch.confidence:g}\u00a0% interval {percent_range(batch.interval)}"
    counts = f"{batch.passed:,} of {batch.episodes:,} episodes passed{rate} ({sure}) {batch.where()}{canceled}."
    return " ".join([counts, *batch.like_these.sentences()])


def _world_rate(world: WorldReport) -> float:
    return world.passed / world.episodes if world.episodes else 2.0


def _world_row(world: WorldReport) -> tuple[str, ...]:
    rate = percent(world.passed / world.episodes) if world.episodes else "-"
    why: dict[str, int] = {}
    for reason in (each for group in world.groups for each in group.reasons):
        why[reason.reason] = why.get(reason.reason, 0) + reason.episodes
    said = ", ".join(f"{count} x {reason}" for reason, count in sorted(why.items(), key=lambda each: -each[1]))
    return code_span(world.label, 100), f"{world.passed} of {world.episodes}", rate, code_span(said)


def _failure_blocks(batch: CountedBatch, worlds: list[WorldReport]) -> Iterator[str]:
    found = [(world, group, example) for world in worlds for group in world.groups for example in group.examples]
    rows = [
        (
            code_span(world.label, 100),
            code_span(group.name, 200),
            str(example.seed),
            code_span(f"{example.reason} {example.explanation}"),
            code_span(example.replay, 500),
        )
        for world, group, example in found[:_MOST_FAILURES]
    ]
    all_failures = batch.episodes - batch.passed
    if rows:
        where = "each command drives its episode again where the store is (docs/guide/ci.md)"
        yield f"### Failures\n\n{len(rows)} of {all_failures:,}; {where}."
        yield table(("world", "group", "seed", "why", "replay"), rows)


def _stages(report: FullReport) -> Iterator[str]:
    rows = (
        (stage.name, code_span(stage.status), f"{stage.seconds:.1f}", code_span(stage.summary))
        for stage in report.stages
    )
    yield table(("stage", "status", "seconds", "what came of it"), rows)
    yield "\n".join(
        f"- {stage.name}, {code_span(artefact.label)}: {code_span(artefact.url, 500)}"
        for stage in report.stages
        for artefact in stage.artefacts
    )
    yield f"Run {code_span(report.run)} in {code_span(report.store, 500)}" if report.run else ""


COMMENT_CHARACTERS = 65_536
"""GitHub takes no longer comment; GitLab takes a million."""
MARKER = "<!-- simyard compare -->"
"""What a program finds its own comment by, to replace it."""
_FOLDED_FROM = 5
# A line has some 700 characters, of which commands are the most.
_MOST_FLIPS = 30
_ANSWER_SIGNS: Mapping[ComparisonAnswer, str] = {"NO WORSE": "✅", "WORSE": "❌", "INCONCLUSIVE": "❔"}
_MEANINGS: Mapping[ComparisonAnswer, str] = {
    "NO WORSE": "the second batch is no worse than the first, by more than the margin",
    "WORSE": "the second batch is worse than the first, by more than the margin",
    "INCONCLUSIVE": "there are too few pairs to say whether the second batch is worse by more than the margin",
}
Replay = Callable[[int], str]


# What a stranger may have written stands in code, as in the summary of a run.
def comparison_markdown(
    found: Comparison, notes: Sequence[str], replays: tuple[Replay, Replay], most: int = COMMENT_CHARACTERS
) -> str:
    """Returns a comparison as a comment of at most so many characters.

    Args:
        found: The comparison.
        notes: What was compared and what not, a line each, and warnings.
        replays: The commands that drive an episode of each batch again, by its index.
        most: Also in bytes.
    """
    return bounded_page(_comparison_blocks(found, notes, replays), most)


def _comparison_blocks(found: Comparison, notes: Sequence[str], replays: tuple[Replay, Replay]) -> Iterator[str]:
    yield f"{MARKER}\n## {_ANSWER_SIGNS[found.answer]} {found.answer}"
    yield f"{_MEANINGS[found.answer].capitalize()}: {_difference(found)}."
    yield f"{_upper_first(other_worlds(found))}."
    sure = f"{100 * found.confidence:g}\u00a0% interval {found.where()}"
    yield table(("batch", "passed", "rate", sure), _rates(found))
    yield "\n".join(f"- {code_span(note, 1_000)}" for note in notes)
    gains = [flip for flip in found.pairs.flips if flip.gained]
    losses = [flip for flip in found.pairs.flips if not flip.gained]
    yield from _flips("lost: passed before, not now", losses, replays)
    yield from _flips("gained: not passed before, passed now", gains, replays)
    if not found.pairs.flips:
        yield "No episode came out differently."


def _difference(found: Comparison) -> str:
    low, high = 100 * found.interval.lower, 100 * found.interval.upper
    return (
        f"difference {100 * found.difference:+.1f} points ({100 * found.confidence:g}\u00a0% interval {low:+.1f} to "
        f"{high:+.1f}) {found.where()}, margin {100 * found.margin:g}; {found.pairs.gains} gained and "
        f"{found.pairs.losses} lost of {found.pairs.pairs} pairs, McNemar p = {found.p_value:.3g}"
    )


def _upper_first(text: str) -> str:
    return text[:1].upper() + text[1:]


def _rates(found: Comparison) -> Iterator[tuple[str, ...]]:
    pairs = found.pairs
    for name, passed in ((found.first, pairs.first_passed), (found.second, pairs.second_passed)):
        sure = wilson(passed, pairs.pairs, found.confidence)
        yield code_span(name), f"{passed:,} of {pairs.pairs:,}", percent(passed / pairs.pairs), percent_range(sure)


def _flips(what: str, flips: Sequence[EpisodeFlip], replays: tuple[Replay, Replay]) -> Iterator[str]:
    if not flips:
        return
    heading = f"{len(flips):,} {'episodes' if len(flips) > 1 else 'episode'} {what}"
    head = ("world", "seed", "variables", "before", "now", "replay before", "replay now")
    body = table(head, (_row(flip, replays) for flip in flips[:_MOST_FLIPS]))
    if len(flips) > _MOST_FLIPS:
        body += f"\n\n{len(flips) - _MOST_FLIPS:,} more; `simyard compare --json` has all."
    yield details(heading, body) if len(flips) > _FOLDED_FROM else f"### {heading}\n\n{body}"


def _row(flip: EpisodeFlip, replays: tuple[Replay, Replay]) -> tuple[str, ...]:
    variables = " ".join(f"{name}={value}" for name, value in sorted(flip.environment.items()))
    before, now = (code_span(reason or "passed", 60) for reason in (flip.before, flip.after))
    commands = (
        code_span(command(index), 500) for command, index in zip(replays, (flip.first, flip.second), strict=True)
    )
    return code_span(flip.world, 100), str(flip.seed), code_span(variables, 150), before, now, *commands


MOST_OF_A_KIND = 10
_LONGEST_ANNOTATION = 500
_FAILED_STATUSES = frozenset({"Failed", "Refused", "TimedOut", "Canceled"})
_Level = Literal["error", "warning"]


class Annotation(NamedTuple):
    """What GitHub shows beside a run; neither field is escaped yet."""

    level: _Level
    title: str
    message: str


def workflow_commands(report: FullReport, file: str) -> list[str]:
    """Returns the commands that annotate the run, at most as many as GitHub shows.

    Args:
        report: The run.
        file: The document, as its path in the repository; empty for none.
    """
    found = list(_annotations(report))
    return [
        workflow_command(each, file)
        for level in ("error", "warning")
        for each in _limited([each for each in found if each.level == level])
    ]


def workflow_command(annotation: Annotation, file: str = "") -> str:
    """Returns the command that makes an annotation; nothing in its text ends it or begins another.

    See GitHub's documentation, "Workflow commands": ``%``, ends of lines and, in properties, ``:`` and ``,`` are
    escaped.
    """
    place = f"file={_property(file)},line=1," if file else ""
    title = _property(_cut(annotation.title))
    return f"::{annotation.level} {place}title={title}::{_data(_cut(annotation.message))}"


def _annotations(report: FullReport) -> Iterator[Annotation]:
    name = report.document
    if failure := report.failure:
        said = "; ".join([failure.reason, *map(str, failure.faults)])
        yield Annotation("error", f"{name}: {failure.stage or failure.code}", said)
    for rule in report.gate.rules if report.gate else ():
        if rule.verdict != "PASS":
            yield Annotation("error" if rule.verdict == "FAIL" else "warning", f"{name}: {rule.title}", rule.sentence)
    for stage in report.stages:
        if stage.name == "deployment" and stage.status in _FAILED_STATUSES:
            yield Annotation("error", f"{name}: deployment {stage.status}", stage.summary)
        if "alarm" in stage.facts:
            yield Annotation("warning", f"{name}: {stage.name}", str(stage.facts["alarm"]))
    for problem in report.problems:
        yield Annotation("warning", f"{name}: report", problem)
    yield from _group_annotations(report)


def _group_annotations(report: FullReport) -> Iterator[Annotation]:
    """Yields a warning for each group that is not as it should be, the worst first."""
    worlds = report.batch.worlds if report.batch else ()
    bad = [(world, group) for world in worlds for group in world.groups if group.state in {"failed", "error"}]
    for world, group in sorted(bad, key=lambda each: each[1].rate or 0.0):
        reasons = ", ".join(f"{each.episodes} x {each.reason}" for each in group.reasons)
        replay = "".join(f"; {example.replay}" for example in group.examples[:1])
        counts = f"{group.passed} of {group.episodes} episodes passed"
        yield Annotation("warning", f"{world.label}: {group.name}", f"{counts}: {reasons}{replay}")


def _limited(found: Sequence[Annotation]) -> list[Annotation]:
    if len(found) <= MOST_OF_A_KIND:
        return list(found)
    shown = found[: MOST_OF_A_KIND - 1]
    more = f"{len(found) - len(shown)} more; the summary of this step lists them"
    return [*shown, Annotation(found[0].level, "and more", more)]


def _cut(text: str) -> str:
    line = terminal_line(text)
    return line if len(line) <= _LONGEST_ANNOTATION else f"{line[: _LONGEST_ANNOTATION - 1]}…"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(terminal_line(text)).replace(":", "%3A").replace(",", "%2C")
