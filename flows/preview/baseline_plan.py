"""What a gate will judge a planned batch by: how many episodes, and how many pairs with the other version."""

import math
from collections import Counter
from dataclasses import dataclass

from flows.document.tested_batch import candidates
from specs.pipeline.gate_section import NoWorseThan
from tasks.simulate.batch.job import KIND, plan_of
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import is_terminal, records

_Conditions = tuple[str, ...]


@dataclass(frozen=True)
class GateBasis:
    """What a gate is going to judge by.

    Attributes:
        episodes: Of the tested version; of all versions where none is compared with another.
        pairs: Episodes that the tested version and the other one drive both.
        no_baseline: Why there is nothing to compare with, where that is certain beforehand; else empty.
    """

    episodes: int
    pairs: int
    no_baseline: str = ""


def gate_basis(plan: BatchPlan, rule: NoWorseThan | None, baseline: str, store: Store) -> GateBasis:
    """Returns what a gate is going to judge a batch by.

    Args:
        plan: The batch.
        rule: The gate's comparison, if it has one.
        baseline: Digest of the version to compare with; empty if the batch tests several applications.
        store: Where other batches are.
    """
    everything = _episodes(plan, _templates(plan, frozenset(template.robot.digest for template in plan.templates)))
    if rule is None:
        return GateBasis(everything, everything)
    names = sorted({template.robot.name for template in plan.templates})
    meant = candidates(plan, baseline)
    if len(names) != 1:
        return GateBasis(everything, 0, f"the batch tests several applications ({', '.join(names)})")
    if len(meant) != 1:
        return GateBasis(everything, 0, f"the batch tests several versions besides version {rule.applicationVersion}")
    tested = _templates(plan, meant)
    episodes = _episodes(plan, tested)
    other = _templates(plan, frozenset({baseline}))
    if other:
        return GateBasis(episodes, _common(plan, tested, other))
    if _may_be_there(plan, baseline, store):
        return GateBasis(episodes, episodes)
    return GateBasis(episodes, 0, "no batch that Completed drove that version on any of these seeds")


def _templates(plan: BatchPlan, digests: frozenset[str]) -> list[JobTemplate]:
    return [template for template in plan.templates if template.robot.digest in digests]


def _episodes(plan: BatchPlan, templates: list[JobTemplate]) -> int:
    return sum(len(plan.worlds_of(template)) for template in templates) * _variants(plan)


def _common(plan: BatchPlan, tested: list[JobTemplate], other: list[JobTemplate]) -> int:
    ours, theirs = (Counter(_conditions(plan, templates)) for templates in (tested, other))
    return (ours & theirs).total() * _variants(plan)


def _variants(plan: BatchPlan) -> int:
    """Returns how many episodes there are of each request and world."""
    return len(plan.seeds) * math.prod(map(len, plan.sweep.values()))


def _conditions(plan: BatchPlan, templates: list[JobTemplate]) -> list[_Conditions]:
    """Returns what is asked of the robot in each world of each request, as ``pairs`` pairs episodes."""
    return [
        (world, scenario.digest, scenario.package, scenario.launch_file, str(template.duration_s), *own)
        for template in templates
        for own in [
            [f"{name}={value}" for name, value in sorted(template.environment.items()) if name not in plan.sweep]
        ]
        for scenario in [template.scenario]
        for world in plan.worlds_of(template)
    ]


def _may_be_there(plan: BatchPlan, baseline: str, store: Store) -> bool:
    """Returns whether a batch drove the version on one of the seeds, or may yet; only its rows say on which worlds."""
    for record in records(store, KIND):
        if record.status == "Completed" or not is_terminal(record):
            theirs = plan_of(record)
            if set(theirs.seeds) & set(plan.seeds) and _templates(theirs, frozenset({baseline})):
                return True
    return False
