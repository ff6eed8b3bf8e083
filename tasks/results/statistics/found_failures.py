"""What a search over a batch found, as it is kept beside the batch for its report, for replays and for the gate."""

from collections.abc import Mapping

from pydantic import JsonValue

from specs.base import Spec
from specs.pipeline.search_section import Search
from tasks.results.statistics.rare_failures import FailureProbability
from tasks.storage.base.keys import result_key
from tasks.storage.base.store import Store, encode_document, find_document

SEARCH_FILE = "search.json"


class FoundFailure(Spec):
    """An episode that failed in a search, with all that it takes to drive it again.

    Attributes:
        world: ``<generation>/<world>``.
        seed: As a batch's matrix names it.
        environment: The variables that were varied.
        reason: Why it failed.
    """

    world: str
    seed: int
    environment: dict[str, str]
    reason: str

    @property
    def circumstances(self) -> str:
        """The world, the seed and the variables, for a person."""
        own = "".join(f", {name}={value}" for name, value in self.environment.items())
        return f"{self.world}, seed {self.seed}{own}"


class BatchSearch(Spec):
    """A search, and what it found.

    Attributes:
        batch: The batch that was searched.
        search: What was searched for.
        probability: How probable a failure is.
        failures: Those that were found, each once, in the order in which they were; the first ones.
        failed: How many episodes failed in all.
    """

    batch: str
    search: Search
    probability: FailureProbability
    failures: tuple[FoundFailure, ...]
    failed: int

    def facts(self) -> Mapping[str, JsonValue]:
        """Returns the numbers of a stage's report."""
        return {"probability": self.probability.model_dump(mode="json"), "failed": self.failed}


def write_search(store: Store, found: BatchSearch) -> str:
    """Writes what a search of a batch's document found beside the batch, and returns its URL."""
    key = result_key(found.batch, SEARCH_FILE)
    store.put(key, encode_document(found))
    return f"{store.url}/{key}"


def read_search(store: Store, batch: str) -> BatchSearch | None:
    """Returns what the search of a batch's document found; None where there was none."""
    return find_document(store, result_key(batch, SEARCH_FILE), BatchSearch)
