"""The summary of a step: what it says, how long it may be, and nothing of a stranger's that becomes markup."""

import pytest

from specs.data.episode import EpisodeResult
from tasks.results.ci.full_report import CountedBatch, FullReport, RunFailure
from tasks.results.ci.github import SUMMARY_BYTES, summary_markdown
from tests.factories.episodes import crashed, request
from tests.results.ci.full_reports import HOSTILE, counted, failed_report, full_report, rule, stage
from tests.results.ci.markdown_pages import markdown_parts
from tests.results.estimands import intervals, without_estimand


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
