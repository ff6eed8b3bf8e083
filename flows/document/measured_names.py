"""The names of metrics in a gate's rules, held against what the scenarios of its document measure."""

from collections.abc import Iterable
from pathlib import Path

from specs.arn import reference_path
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import Gate
from specs.pipeline.simulation_section import SimulationBatch
from specs.robomaker.bundle import LATEST
from tasks.applications.registry import unpack
from tasks.results.gate.rules.metric_names import metric_faults
from tasks.simulate.application.declared_metrics import declared_metrics
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.storage.base.cache_folder import cache_folder
from tasks.storage.base.store import Store


def check_own_names(spec: PipelineSpec, base: Path) -> None:
    """Refuses metrics that no scenario measures, where the document brings all of its scenarios along.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With a fault for each rule about such a metric.
    """
    if spec.gate is None or spec.simulationBatch is None or not spec.gate.quantiles:
        return
    own = {each.name: base / each.source for each in spec.applications if each.kind == "simulation"}
    used = _scenarios(spec.simulationBatch)
    if used and used <= own.keys():
        _require(spec.gate, _declared(own[name] for name in sorted(used)))


def check_planned_names(gate: Gate | None, plan: BatchPlan, store: Store) -> None:
    """Refuses metrics that no scenario of a batch measures.

    Args:
        gate: The document's gate.
        plan: The batch.
        store: Where its bundles are.

    Raises:
        DocumentError: With a fault for each rule about such a metric.
    """
    if gate is None or not gate.quantiles:
        return
    _require(gate, planned_names(plan, store))


def planned_names(plan: BatchPlan, store: Store) -> frozenset[str] | None:
    """Returns the names of all metrics that the scenarios of a batch measure; None where that is not known.

    Args:
        plan: The batch.
        store: Where its bundles are.

    Raises:
        ObjectNotFound: A bundle is gone.
    """
    digests = dict.fromkeys(template.scenario.digest for template in plan.templates)
    return _declared(unpack(store, digest, cache_folder() / "bundles") for digest in digests)


def _scenarios(section: SimulationBatch) -> set[str]:
    """Returns the names of a batch's scenarios; one that is not the document's own is named so that it never is."""
    uses = [use for request in section.createSimulationJobRequests for use in request.simulationApplications or ()]
    return {
        reference_path(use.application) if use.applicationVersion in {None, LATEST} else f"{use.application}@"
        for use in uses
    }


def _declared(bundles: Iterable[Path]) -> frozenset[str] | None:
    found = [declared_metrics(bundle) for bundle in bundles]
    known = [names for names in found if names is not None]
    # Where one is not known, it may measure anything.
    return frozenset[str]().union(*known) if len(known) == len(found) else None


def _require(gate: Gate, known: frozenset[str] | None) -> None:
    faults = metric_faults(gate, sorted(known)) if known is not None else []
    if faults:
        raise DocumentError(faults)
