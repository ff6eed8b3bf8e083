"""A small document whose batch is searched, in a folder of its own, and what the search leaves."""

from pathlib import Path

from tasks.storage.base.store import Store
from tests.integration.runs import small_document, write_document


def searched_document(folder: Path, **changes: object) -> Path:
    """Returns the file of a document that searches the courier's episodes, and whose gate asks what came of that."""
    document = small_document(
        name="searched",
        search={
            "over": {"MAX_SPEED": {"uniform": [0.2, 0.8]}},
            "budget": {"episodes": 1_000},
        },
        gate={"failureProbability": {"atMost": 0.5}},
        **changes,
    )
    document.pop("deployment")
    document.pop("worldExport", None)
    return write_document(folder, document)


def searched(store: Store) -> dict[str, bytes]:
    """Returns what a search has left: its steps, what it found, and the gate's evidence."""
    named = [key for key in store.keys("results/") if key.endswith(("search.json", "evidence.json"))]
    return {key: store.get(key).body for key in [*store.keys("searches/"), *named]}
