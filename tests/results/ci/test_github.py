"""What GitHub shows of a run or a comparison: complete, bounded, and nothing in it is markup that a stranger wrote."""

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from markdown_it.token import Token

from specs.data.episode import EpisodeResult
from tasks.results.batch_comparison import CommonEpisodes, ComparedWorld, EpisodeFlip, comparison
from tasks.results.ci.full_report import CountedBatch, FullReport, RunFailure
from tasks.results.ci.github import (
    COMMENT_CHARACTERS,
    MARKER,
    SUMMARY_BYTES,
    Annotation,
    comparison_markdown,
    summary_markdown,
    workflow_command,
    workflow_commands,
)
from tests.factories.episodes import collided, crashed, request
from tests.results.ci.full_reports import HOSTILE, counted, failed_report, full_report, rule, stage
from tests.results.estimands import intervals, without_estimand


class MarkdownParts(NamedTuple):
    """What a page of Markdown holds.

    Attributes:
        code: Texts in code.
        plain: Other texts.
        html: Elements of HTML.
        links: How many links and pictures there are.
        cells: How many cells each row of a table has, table by table.
    """

    code: list[str]
    plain: list[str]
    html: list[str]
    links: int
    rows: list[int]


def markdown_parts(page: str) -> MarkdownParts:
    """Returns what a page holds, as CommonMark with GitHub's tables reads it."""
    tokens = list(_flat(MarkdownIt("commonmark").enable("table").parse(page)))
    rows: list[int] = []
    for token in tokens:
        if token.type == "tr_open":
            rows.append(0)
        elif token.type in {"td_open", "th_open"}:
            rows[-1] += 1
    return MarkdownParts(
        code=[token.content for token in tokens if token.type == "code_inline"],
        plain=[token.content for token in tokens if token.type == "text" and token.content],
        html=[token.content for token in tokens if token.type in {"html_block", "html_inline"}],
        links=sum(token.type in {"link_open", "image"} for token in tokens),
        rows=rows,
    )


def _flat(tokens: list[Token]) -> Iterator[Token]:
    for token in tokens:
        yield token
        yield from _flat(token.children or [])


def test_it_shows_the_answer_the_rules_the_rates_and_how_to_replay():
    text = summary_markdown(full_report())
    assert text.startswith("## ❌ Not passed: `nightly`\n\n`FAIL: of 2 rules`\n")
    assert "| `successRate` | ❌ FAIL | 0.500 | 0.200 to 0.800 (Wilson) | 10 |" in text
    assert "| `world-2-1` | 0 of 4 |" in text
    assert "`simyard replay arn:simyard:simulation-job:0123456789ab:simb-1/" in text
    assert "`file:///tmp/report.html`" in text


def test_it_says_of_which_worlds_the_rate_is_and_what_it_is_in_worlds_like_these():
    text = summary_markdown(full_report(gate=None)).replace("\u00a0", " ")
    assert "6 of 10 episodes passed: 60.0 % (95 % interval 31.2 to 83.2 %) in these 2 worlds; 2 canceled." in text
    assert "The rate in worlds like these 2: 95 % interval " in text
    assert intervals(text) == 2
    assert without_estimand(text) == []


@pytest.mark.parametrize(
    ("report", "beginning"),
    [
        (failed_report(), "## 💥 A stage failed: `nightly`\n\n`InternalServiceError`: `nobody answers`"),
        (full_report(answer="INCONCLUSIVE"), "## ❔ INCONCLUSIVE: `nightly`"),
        (full_report(answer="PASSED", gate=None), "## ✅ Passed: `nightly`\n\nNo gate was asked for"),
    ],
)
def test_each_answer_has_its_heading(report: FullReport, beginning: str):
    assert summary_markdown(report).startswith(beginning)


def _hostile_report() -> FullReport:
    gate = full_report().gate
    assert gate
    rules = (rule("FAIL", sentence=HOSTILE).model_copy(update={"facts": {"column": HOSTILE}}),)
    results = [crashed(index).model_copy(update={"failure_reason": HOSTILE}) for index in range(2)]
    asked = [request(index, world=f"{HOSTILE}/{HOSTILE}", environment={HOSTILE: str(index)}) for index in range(2)]
    return full_report(
        document=HOSTILE,
        store=HOSTILE,
        run=HOSTILE,
        gate=gate.model_copy(update={"sentence": HOSTILE, "rules": rules}),
        batch=counted(asked, results),
        stages=(stage(summary=HOSTILE, status=HOSTILE, facts={"alarm": HOSTILE}),),
        problems=(HOSTILE,),
    )


def test_nothing_that_a_stranger_wrote_is_more_than_code():
    failure = RunFailure(code=HOSTILE, reason=HOSTILE)
    for report in (_hostile_report(), full_report(answer="FAILED", failure=failure, gate=None, batch=None)):
        parts = markdown_parts(summary_markdown(report))
        assert parts.links == 0
        assert all(each.startswith(("<details><summary>", "</details>")) for each in parts.html)
        assert not [text for text in (*parts.plain, *parts.html) if "evil" in text or "@" in text or "script" in text]
        assert any("evil.example" in text for text in parts.code)


def test_rows_keep_their_cells_whatever_stands_in_them():
    assert set(markdown_parts(summary_markdown(_hostile_report())).rows) == {4, 5, 6}


def _large() -> CountedBatch:
    worlds = [request(index, world=f"g/{'w' * 200}{index}") for index in range(400)]
    results: list[EpisodeResult] = [
        crashed(index).model_copy(update={"failure_reason": "é" * 5_000}) for index in range(400)
    ]
    return counted(worlds, results)


@pytest.mark.parametrize("most", [0, 100, 2_000, 20_000, SUMMARY_BYTES])
def test_it_is_never_longer_than_it_may_be(most: int):
    text = summary_markdown(full_report(batch=_large()), most)
    assert len(text.encode()) <= most
    assert text.count("<details>") == text.count("</details>")


def test_a_summary_that_was_cut_says_so():
    assert summary_markdown(full_report(batch=_large()), 2_000).endswith("longer than the page may be._\n")


def _flip(number: int, before: str, after: str, world: str = "g/w") -> EpisodeFlip:
    environment = {"MAX_SPEED": "0.6"}
    return EpisodeFlip(
        world=world, seed=number, environment=environment, first=number, second=number + 100, before=before, after=after
    )


def _comment(flips: Sequence[EpisodeFlip], pairs: int = 2_000, name: str = "simb-2", notes: Sequence[str] = ()) -> str:
    gains = sum(flip.gained for flip in flips)
    common = CommonEpisodes(
        pairs=pairs,
        first_passed=pairs // 2,
        second_passed=pairs // 2 + gains - (len(flips) - gains),
        first_alone=0,
        second_alone=0,
        canceled=0,
        by_world=tuple(ComparedWorld(world=f"g/{world}", pairs=48, gains=0, losses=0) for world in range(4)),
        flips=tuple(flips),
        origins=(),
    )
    found = comparison("simb-1", name, common, margin=0.02, confidence=0.95)
    return comparison_markdown(found, notes, (lambda index: f"simyard replay a/{index}", lambda index: f"b/{index}"))


def test_it_shows_the_answer_the_rates_and_the_pairs_that_changed_in_both_directions():
    text = _comment([_flip(1, "", "collision"), _flip(2, "timeout", "")])
    assert text.startswith(f"{MARKER}\n## ✅ NO WORSE\n\n")
    assert "difference +0.0 points (95\u00a0% interval" in text
    lost, gained = text.split("### ")[1:]
    assert lost.startswith("1 episode lost: ")
    assert gained.startswith("1 episode gained: ")
    assert "| `g/w` | 1 | `MAX_SPEED=0.6` | `passed` | `collision` | `simyard replay a/1` | `b/101` |" in lost
    assert "| `timeout` | `passed` |" in gained


def test_it_says_of_which_worlds_each_interval_is():
    text = _comment([_flip(1, "", "collision"), _flip(2, "timeout", "")])
    assert "in these 4 worlds, margin 2;" in text
    assert "\n\nIn worlds like these 4 the answer would be INCONCLUSIVE (" in text
    assert intervals(text) == 2 + 2
    assert without_estimand(text) == []


def test_long_lists_are_folded_and_what_is_left_out_is_counted():
    text = _comment([_flip(number, "", "stuck") for number in range(50)])
    assert "<details><summary>50 episodes lost: passed before, not now</summary>" in text
    assert "20 more; `simyard compare --json` has all." in text


@pytest.mark.parametrize("count", [0, 10, 5_000])
def test_it_is_never_longer_than_a_comment_may_be(count: int):
    flips = [_flip(number, "", HOSTILE * 40, world="é" * 4_000) for number in range(count)]
    flips += [_flip(number, HOSTILE * 40, "", world="é" * 4_000) for number in range(count)]
    text = _comment(flips, 20_000, notes=["é" * 4_000] * 100)
    assert len(text.encode()) <= COMMENT_CHARACTERS
    assert text.count("<details>") == text.count("</details>")


def test_without_changes_it_says_so():
    assert "No episode came out differently." in _comment([])


def test_nothing_in_a_comment_that_a_stranger_wrote_is_more_than_code():
    hostile = _flip(1, "", HOSTILE, world=HOSTILE).model_copy(update={"environment": {HOSTILE: HOSTILE}})
    parts = markdown_parts(_comment([hostile], name=HOSTILE, notes=[HOSTILE]))
    assert parts.links == 0
    assert parts.html == [f"{MARKER}\n"]
    assert not [text for text in parts.plain if "evil" in text or "@" in text or "script" in text]
    assert set(parts.rows) == {4, 7}


def _read(line: str) -> tuple[str, dict[str, str], str]:
    """Returns command, properties and message of a line, as the runner takes it apart (ActionCommand.cs)."""
    found = re.fullmatch(r"::(\w+)(?: ([^:]*))?::(.*)", line)
    assert found, line
    pairs = [part.partition("=") for part in (found[2] or "").split(",") if part]
    return found[1], {name: _unescaped(value) for name, _, value in pairs}, _unescaped(found[3])


def _unescaped(text: str) -> str:
    for escape, sign in (("%2C", ","), ("%3A", ":"), ("%0A", "\n"), ("%0D", "\r"), ("%25", "%")):
        text = text.replace(escape, sign)
    return text


def test_a_rule_that_fails_is_an_error_and_an_inconclusive_one_a_warning():
    found = [_read(line) for line in workflow_commands(full_report(), "documents/nightly.yaml")]
    assert [(command, parts["title"]) for command, parts, _ in found[:2]] == [
        ("error", "nightly: successRate"),
        ("warning", "nightly: collisionRate"),
    ]
    assert {parts["file"] for _, parts, _ in found} == {"documents/nightly.yaml"}


def test_a_failed_group_is_a_warning_with_its_replay_command():
    *_, (command, parts, message) = [_read(line) for line in workflow_commands(full_report(), "")]
    assert (command, parts["title"]) == (
        "warning",
        "world-2-1: courier go_to_goal in delivery rooms, MAX_SPEED=0.6",
    )
    assert message.startswith("0 of 4 episodes passed: 2 x RobotApplicationCrash, 2 x collision; simyard replay arn:")


def test_a_stage_that_failed_is_an_error():
    (found,) = [_read(line) for line in workflow_commands(failed_report(), "")]
    assert found == ("error", {"title": "nightly: worldExport"}, "nobody answers")


def test_there_are_no_more_of_a_kind_than_github_shows():
    asked = [request(index, world=f"g/{index}") for index in range(30)]
    rules = tuple(rule("FAIL", f"quantiles[{number}]") for number in range(30))
    gate = full_report().gate
    assert gate
    report = full_report(
        gate=gate.model_copy(update={"rules": rules}),
        batch=counted(asked, [collided(index) for index in range(30)]),
        stages=(stage(facts={"alarm": "look"}),),
    )
    lines = workflow_commands(report, "")
    assert [sum(line.startswith(f"::{kind} ") for line in lines) for kind in ("error", "warning")] == [10, 10]
    assert "21 more" in lines[9]


@settings(max_examples=50)
@example(HOSTILE, HOSTILE, HOSTILE)
@given(st.text(), st.text(), st.text())
def test_no_text_makes_another_command(title: str, message: str, file: str):
    line = workflow_command(Annotation("error", title, message), file)
    assert len(line.splitlines()) == 1
    command, parts, _ = _read(line)
    assert command == "error"
    assert set(parts) <= {"file", "line", "title"}


def test_a_percent_sign_is_not_read_as_the_end_of_a_line():
    assert workflow_command(Annotation("error", "a", "b%0A::error::c")) == "::error title=a::b%250A::error::c"
