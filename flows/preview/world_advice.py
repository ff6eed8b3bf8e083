"""What `simyard plan` says of worlds and seeds: how alike episodes of one world are, and which layout tells more."""

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from specs.pipeline.gate_section import Gate
from specs.pipeline.generation_parts import MAX_WORLDS_OF_DOCUMENT
from tasks.results.statistics.power.shares import effective_episodes
from tasks.storage.base.keys import jobs_prefix
from tasks.storage.base.store import Store

ASSUMED = (0.0, 0.05, 0.1)
_NIGHTS = 5
_WORTH_SAYING = 0.75
_LAYOUTS = 2


class SeenSpread(NamedTuple):
    """How alike the episodes of one world were.

    Attributes:
        nights: In how many earlier batches, the newest.
        icc: Their intra-world correlation in the mean, 0-1; None where too few failed to say.
    """

    nights: int
    icc: float | None


def seen_spread(store: Store, document: str) -> SeenSpread | None:
    """Returns how alike episodes of a world were in a document's newest batches; None where there is none.

    Of batches that the cache folder knows, nothing is read from the store.

    Args:
        store: Where the document's runs are.
        document: Its name.
    """
    if next(iter(store.keys(jobs_prefix("pipeline-run"))), None) is None:
        return None
    from flows.trend.history import read_history  # noqa: PLC0415 - tables, where there is something to read
    from tasks.results.statistics.worlds.world_spread import world_spread  # noqa: PLC0415 - likewise
    from tasks.results.trend.measure import Measure  # noqa: PLC0415 - likewise

    counted = [night for night in read_history(store, document, Measure()).nights if night.cells]
    newest = sorted({night.request: night for night in counted}.values(), key=lambda night: night.begun_at_s)[-_NIGHTS:]
    iccs: list[float] = []
    for night in newest:
        passed, episodes = Counter[str](), Counter[str]()
        for cell in night.cells:
            passed[cell.world] += cell.successes
            episodes[cell.world] += cell.n
        found = world_spread([passed[world] for world in episodes], list(episodes.values())).icc
        iccs += [] if found is None else [found]
    return SeenSpread(len(newest), sum(iccs) / len(iccs) if iccs else None) if newest else None


def world_lines(gate: Gate, seen: SeenSpread | None, *, episodes: int, worlds: int, seeds: int) -> Iterator[str]:
    """Yields what a batch's layout is worth, where that matters: a rule over worlds, or episodes that are alike.

    Args:
        gate: The document's gate.
        seen: What earlier batches showed; None of none.
        episodes: Of the tested version.
        worlds: In how many worlds they are.
        seeds: Of the matrix.
    """
    over = any(getattr(rule, "over", None) == "worlds" for rule in _rules(gate))
    icc = seen.icc if seen else None
    if not worlds or not episodes or not (over or icc):
        return
    per_world = max(1, round(episodes / worlds))
    laid_out = f"{worlds} worlds x {per_world} episodes"
    if icc is None:
        worth = " / ".join(f"{effective_episodes(worlds, per_world, each):.0f}" for each in ASSUMED)
        why = "earlier batches: too few failed" if seen else "no earlier batch"
        yield f"{why}: {laid_out} are worth {worth} independent ones at an ICC of 0 / 0.05 / 0.1"
    else:
        batches = f"{seen.nights if seen else 0} earlier batch{'' if seen and seen.nights == 1 else 'es'}"
        worth = f"{effective_episodes(worlds, per_world, icc):.0f}"
        yield f"{batches}: ICC {icc:.2f}; {laid_out} are worth {worth} independent ones in worlds like these"
    yield from _better(icc if icc is not None else ASSUMED[1], episodes, worlds, seeds)


def _better(icc: float, episodes: int, worlds: int, seeds: int) -> Iterator[str]:
    """Yields a layout of as many episodes that is worth much more, with what to write."""
    now = effective_episodes(worlds, max(1, round(episodes / worlds)), icc)
    layouts = [(worlds * seeds // each, each) for each in range(1, seeds) if seeds % each == 0]
    layouts = [layout for layout in layouts if layout[0] <= MAX_WORLDS_OF_DOCUMENT]
    for more, left in layouts[:: max(1, len(layouts) - 1)][::-1][:_LAYOUTS]:
        per_world = max(1, round(episodes / more))
        worth = effective_episodes(more, per_world, icc)
        if now < _WORTH_SAYING * worth:
            written = f"worldCount: {{floorplanCount: {more}}} and seeds: {left}"
            yield f"{more} worlds x {per_world} would be worth {worth:.0f}: write {written}"


def _rules(gate: Gate) -> list[object]:
    return [gate.successRate, gate.collisionRate, gate.noWorseThan, *(gate.quantiles or ())]
