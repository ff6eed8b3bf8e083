"""What is said of two batches that were compared."""

from tasks.results.compare.comparison_verdict import Comparison


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
