"""What Prefect's pages call the task runs of a batch."""

import pytest

from flows.prefect import tasks
from flows.prefect.tasks import chunk_name
from specs.errors import StoreAway


def test_a_chunk_has_a_name_while_its_store_is_away(monkeypatch: pytest.MonkeyPatch):
    def away(_url: str) -> None:
        raise StoreAway("no answer")

    monkeypatch.setattr(tasks, "open_store", away)
    assert chunk_name({"number": 2, "store_url": "s3://b/p", "batch": "simb-1"}) == "chunk 3"
