"""The rule ``failureProbability``: where the robot will live, a failure is rare enough, by the document's search."""

from collections.abc import Iterator
from math import ceil, log

from specs.pipeline.gate_section import FailureBar
from tasks.results.gate.rules.rule import Completeness, GateMaterial, GateRule, PlannedEpisodes, RuleVerdict
from tasks.results.gate.rules.rule_answers import answer_below, confidence_text, nothing_counted, sentence

_METHODS = {"thinned": "Horvitz-Thompson", "splitting": "multilevel splitting", "draws": "Clopper-Pearson"}


def _judge(asked: FailureBar, material: GateMaterial, label: str) -> RuleVerdict:
    found = material.rare
    if found is None:
        return nothing_counted(label, "the batch was not searched: a run of its document says how rare failures are")
    upper = found.interval.upper if asked.announced else found.highest
    judged = found.interval.model_copy(update={"upper": upper})
    answer = answer_below(judged, asked.atMost, found.episodes, sound=True)
    return RuleVerdict(
        rule=label,
        verdict=answer,
        sentence=sentence(
            answer,
            f"{found.sentence}, {confidence_text(asked.confidence)}",
            f"at most {asked.atMost:g} asked for",
            Completeness(),
        ),
        method=_METHODS[found.method],
        counted=found.episodes,
        estimate=found.estimate,
        lower=found.interval.lower,
        upper=upper,
    )


def _plan(asked: FailureBar, planned: PlannedEpisodes) -> Iterator[str]:
    yield f"fails with a probability of at most {asked.atMost:g}, {confidence_text(asked.confidence)}"
    # Clopper and Pearson's upper bound of no failure at all, which plain draws need at least.
    needed = ceil(log((1.0 - asked.confidence) / 2.0) / log(1.0 - asked.atMost))
    enough = "ENOUGH" if planned.searched >= needed else "NOT ENOUGH"
    yield f"if no plain draw fails, {needed:,} are needed: the search's {planned.searched:,} are {enough}"


RARE_FAILURE = GateRule("failureProbability", _judge, _plan)
