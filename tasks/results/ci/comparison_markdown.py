"""A comparison as a comment for a pull request: the answer, the rates, and every pair that came out differently.

What a stranger may have written stands in code, as in the summary of a run.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence

from specs.artifact_text import code_span
from tasks.results.ci.markdown_blocks import bounded_page, details, table
from tasks.results.compare.comparison import EpisodeFlip
from tasks.results.compare.comparison_sentences import other_worlds
from tasks.results.compare.comparison_verdict import Comparison, ComparisonAnswer
from tasks.results.statistics.intervals import wilson
from tasks.results.statistics.rate_text import percent, percent_range

COMMENT_CHARACTERS = 65_536
"""GitHub takes no longer comment; GitLab takes a million."""
MARKER = "<!-- simyard compare -->"
"""What a program finds its own comment by, to replace it."""
_FOLDED_FROM = 5
# A line has some 700 characters, of which commands are the most.
_MOST_OF_A_KIND = 30
_SIGNS: Mapping[ComparisonAnswer, str] = {"NO WORSE": "✅", "WORSE": "❌", "INCONCLUSIVE": "❔"}
_MEANINGS: Mapping[ComparisonAnswer, str] = {
    "NO WORSE": "the second batch is no worse than the first, by more than the margin",
    "WORSE": "the second batch is worse than the first, by more than the margin",
    "INCONCLUSIVE": "there are too few pairs to say whether the second batch is worse by more than the margin",
}
Replay = Callable[[int], str]


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
    return bounded_page(_blocks(found, notes, replays), most)


def _blocks(found: Comparison, notes: Sequence[str], replays: tuple[Replay, Replay]) -> Iterator[str]:
    yield f"{MARKER}\n## {_SIGNS[found.answer]} {found.answer}"
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
    body = table(head, (_row(flip, replays) for flip in flips[:_MOST_OF_A_KIND]))
    if len(flips) > _MOST_OF_A_KIND:
        body += f"\n\n{len(flips) - _MOST_OF_A_KIND:,} more; `simyard compare --json` has all."
    yield details(heading, body) if len(flips) > _FOLDED_FROM else f"### {heading}\n\n{body}"


def _row(flip: EpisodeFlip, replays: tuple[Replay, Replay]) -> tuple[str, ...]:
    variables = " ".join(f"{name}={value}" for name, value in sorted(flip.environment.items()))
    before, now = (code_span(reason or "passed", 60) for reason in (flip.before, flip.after))
    commands = (
        code_span(command(index), 500) for command, index in zip(replays, (flip.first, flip.second), strict=True)
    )
    return code_span(flip.world, 100), str(flip.seed), code_span(variables, 150), before, now, *commands
