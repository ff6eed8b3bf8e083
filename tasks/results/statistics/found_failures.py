"""What a search over a batch found, as it is kept beside the batch for its report, for replays and for the gate."""

from collections.abc import Mapping

from pydantic import JsonValue

from specs.base import Spec
from specs.pipeline.search_section import Search
from tasks.results.statistics.failure_causes import FailureCauses
from tasks.results.statistics.rare_failures import FailureProbability
from tasks.storage.base.keys import result_key
from tasks.storage.base.store import Store, encode_document, find_document

SEARCH_FILE = "search.json"


class FoundFailure(Spec):
    """An episode that failed in a search, with all that it takes to drive it again, and what came of that.

    Attributes:
        world: ``<generation>/<world>``.
        seed: As a batch's matrix names it.
        environment: The variables that were varied.
        reason: Why it failed.
        replayed: Why it failed when it was simulated again; empty if it passed.
        reference: Likewise on C MuJoCo.
        alike: How many of the failures that were found are nearest to it, itself among them.
    """

    world: str
    seed: int
    environment: dict[str, str]
    reason: str
    replayed: str
    reference: str
    alike: int

    @property
    def circumstances(self) -> str:
        """The world, the seed and the variables, for a person."""
        own = "".join(f", {name}={value}" for name, value in self.environment.items())
        return f"{self.world}, seed {self.seed}{own}"

    @property
    def confirmed(self) -> bool:
        """Whether it fails again: as it did when it is replayed, and on C MuJoCo in whatever way."""
        return self.replayed == self.reason and self.reference != ""

    @property
    def on_reference(self) -> str:
        """What C MuJoCo says, or the replay if that says something else, for a person."""
        if self.replayed != self.reason:
            return f"{self.replayed or 'passed'} when replayed"
        return self.reference or "passed"


class BatchSearch(Spec):
    """A search, and what it found.

    Attributes:
        batch: The batch that was searched.
        search: What was searched for.
        probability: How probable a failure is.
        failures: Those that are reported: unlike each other, and each confirmed.
        vanished: Those that were to be reported, and did not fail again.
        failed: How many episodes failed in all.
        common: How many more failed with the other version, too, where the search is against one.
        causes: What failures have in common.
    """

    batch: str
    search: Search
    probability: FailureProbability
    causes: FailureCauses
    failures: tuple[FoundFailure, ...]
    vanished: tuple[FoundFailure, ...] = ()
    failed: int
    common: int = 0

    @property
    def numbered(self) -> tuple[FoundFailure, ...]:
        """All that can be replayed by their numbers, from 1."""
        return (*self.failures, *self.vanished)

    @property
    def findings(self) -> str:
        """How many failed, how many of them are reported, and how many vanished, for a person."""
        vanished = f"; {len(self.vanished)} more vanished when driven again" if self.vanished else ""
        failed = f"{self.failed:,} episodes failed"
        if self.search.against:
            failed += f" where version {self.search.against} passes, {self.common:,} more with both"
        return f"{failed}; {len(self.failures)} of them, unlike each other, fail again{vanished}"

    def facts(self) -> Mapping[str, JsonValue]:
        """Returns the numbers of a stage's report."""
        return {
            "probability": self.probability.model_dump(mode="json"),
            "failed": self.failed,
            "distinct": len(self.failures),
            "vanished": len(self.vanished),
        }


def write_search(store: Store, found: BatchSearch) -> str:
    """Writes what a search of a batch's document found beside the batch, and returns its URL."""
    key = result_key(found.batch, SEARCH_FILE)
    store.put(key, encode_document(found))
    return f"{store.url}/{key}"


def read_search(store: Store, batch: str) -> BatchSearch | None:
    """Returns what the search of a batch's document found; None where there was none."""
    return find_document(store, result_key(batch, SEARCH_FILE), BatchSearch)
