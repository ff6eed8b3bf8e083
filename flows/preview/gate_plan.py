"""What `simyard plan` says of a gate: its rules, and how many episodes each needs."""

from collections.abc import Iterator

from flows.preview.baseline_plan import GateBasis
from specs.pipeline.gate_section import Gate
from tasks.results.gate.gate import GATE_RULES
from tasks.results.gate.rules.rule import PlannedEpisodes

_INDENT = " " * 18


def gate_lines(
    gate: Gate,
    judged: GateBasis,
    audited: int,
    programs: int = 1,
    *,
    worlds: int = 1,
    lanes: int = 0,
    pairs: bool = False,
    icc: float | None = None,
) -> Iterator[str]:
    """Yields lines for a person: each rule, and what it needs if episodes come out in some ways.

    Args:
        gate: The document's section.
        judged: What it is going to judge by.
        audited: How many of the batch's episodes are driven again on C MuJoCo.
        programs: How many compiled programs the batch has; only of one its episodes can be shuffled, to end it early.
        worlds: In how many worlds the episodes are.
        pairs: Whether two programs are the versions that the gate compares: they take turns on shuffled episodes.
        lanes: Episodes of a chunk, after each of which the gate is asked if it may end the batch early.
        icc: How alike episodes of one world were in earlier batches; None where nothing says that.
    """
    any_look = bool(gate.stopEarly) and (programs == 1 or pairs)
    looks = _looks(judged.episodes, lanes) if any_look and judged.episodes else ()
    planned = PlannedEpisodes(judged.episodes, judged.pairs, audited, judged.no_baseline, worlds, looks, icc)
    lines = [line for rule in GATE_RULES for _, asked in rule.asked(gate) for line in rule.plan(asked, planned)]
    if any_look:
        lines.append(f"may end the batch early, after any chunk{' of both versions' if pairs else ''}")
    elif gate.stopEarly:
        lines.append(f"runs the batch to its end: its {programs} programs cannot be shuffled into common chunks")
    for number, line in enumerate(lines):
        yield f"{'gate':<18}{line}" if number == 0 else f"{_INDENT}{line}"


def _looks(episodes: int, lanes: int) -> tuple[int, ...]:
    from tasks.results.statistics.looks.stopped_batch import looks_of  # noqa: PLC0415 - arrays, which most commands do without

    return looks_of(episodes, lanes or episodes)
