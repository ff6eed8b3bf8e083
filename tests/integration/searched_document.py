"""A small document whose batch is searched, in a folder of its own."""

from pathlib import Path

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
