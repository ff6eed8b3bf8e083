"""A comparison as a comment: which pairs changed, in both directions, and no longer than GitHub takes."""

from collections.abc import Sequence

import pytest

from tasks.results.batch_comparison import CommonEpisodes, ComparedWorld, EpisodeFlip, comparison
from tasks.results.ci.github import COMMENT_CHARACTERS, MARKER, comparison_markdown
from tests.results.ci.full_reports import HOSTILE
from tests.results.ci.markdown_pages import markdown_parts
from tests.results.estimands import intervals, without_estimand


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


def test_nothing_that_a_stranger_wrote_is_more_than_code():
    hostile = _flip(1, "", HOSTILE, world=HOSTILE).model_copy(update={"environment": {HOSTILE: HOSTILE}})
    parts = markdown_parts(_comment([hostile], name=HOSTILE, notes=[HOSTILE]))
    assert parts.links == 0
    assert parts.html == [f"{MARKER}\n"]
    assert not [text for text in parts.plain if "evil" in text or "@" in text or "script" in text]
    assert set(parts.rows) == {4, 7}
