"""`simyard suite`: the failures that a search has found and confirmed, as a document whose batch drives them again."""

from typing import NamedTuple, cast

import yaml
from pydantic import JsonValue

from flows.batch.search_batch import found_request
from flows.batch.shrink import case_request, moved_documents
from specs.errors import DocumentError
from tasks.results.statistics.found_failures import FoundFailure, read_search
from tasks.simulate.batch.batch_record import OpenBatch, load_batch
from tasks.storage.base.store import Store
from tasks.storage.resource_names import find_batch_name

_Document = dict[str, JsonValue]


class Suite(NamedTuple):
    """A regression batch.

    Attributes:
        batch: The batch that was searched.
        failures: Those that it drives, each by one request.
        document: It names no version of the robot, so that it tries the newest one.
    """

    batch: str
    failures: tuple[FoundFailure, ...]
    document: _Document

    def text(self) -> str:
        """Returns the document as YAML, with what it is about on top."""
        worlds = sorted({each.world for each in self.failures})
        about = [
            f"{len(self.failures)} failures that a search over {self.batch} has found and confirmed.",
            "The newest version of the robot is tried. Its worlds must be in the store:",
            *(f"  {world}" for world in worlds),
            *(f"{number}: {each.reason} in {each.circumstances}" for number, each in enumerate(self.failures, 1)),
        ]
        lines = "".join(f"# {' '.join(line.splitlines())}\n" for line in about)
        return lines + yaml.safe_dump(self.document, sort_keys=False, width=100)


def regression_suite(store: Store, text: str) -> Suite:
    """Returns the batch that drives the failures which the search of a batch's document has found.

    Args:
        store: Where the batch is.
        text: ARN or id of the batch, of one of its jobs, or of a run of a document.

    Raises:
        ResourceNotFound: There is no such batch.
        DocumentError: Its document has searched for nothing, or no failure was confirmed.
    """
    batch = load_batch(store, find_batch_name(store, text))
    search = read_search(store, batch.id)
    if search is None or not search.failures:
        allowed = "one whose document has a section search that found a failure"
        raise DocumentError.of("batch", batch.id, allowed, source="simyard")
    plan = batch.plan
    section: _Document = {
        "engine": plan.engine,
        **moved_documents(plan),
        "recordings": {"episodes": "all"},
        "audit": {"lanes": 0},  # C MuJoCo has confirmed each
        "createSimulationJobRequests": [_request(batch, each) for each in search.failures],
    }
    return Suite(batch.id, search.failures, {"name": f"suite-{batch.id}", "simulationBatch": section})


def _request(batch: OpenBatch, failure: FoundFailure) -> JsonValue:
    entry = case_request(batch, found_request(batch, failure), 0)
    (scenario,) = cast("list[_Document]", entry["simulationApplications"])
    own: _Document = {**scenario, "worldConfigs": [{"world": failure.world}]}
    return {"seed": failure.seed, **entry, "simulationApplications": [own]}
