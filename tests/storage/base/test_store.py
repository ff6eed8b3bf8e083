"""A document is changed over exactly what was read, and never lost between several who change it."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from specs.base import Spec
from specs.errors import ObjectCorrupt
from tasks.storage.base.store import Store, encode_document, find_document, update


class Count(Spec):
    """A document."""

    of: int = 0


def one_more(count: Count | None) -> Count:
    """Returns the next count."""
    return Count(of=count.of + 1 if count else 1)


def test_of_many_who_change_a_document_each_sees_what_the_one_before_wrote(file_store: Store) -> None:
    with ThreadPoolExecutor(8) as pool:
        written = list(pool.map(lambda _: update(file_store, "count", Count, one_more).of, range(40)))
    assert sorted(written) == list(range(1, 41))
    assert find_document(file_store, "count", Count) == Count(of=40)


def test_the_very_same_document_and_none_write_nothing(file_store: Store) -> None:
    assert update(file_store, "count", Count, lambda count: count) is None
    assert find_document(file_store, "count", Count) is None
    etag = file_store.create("count", encode_document(Count(of=3)))
    assert update(file_store, "count", Count, lambda count: count) == Count(of=3)
    assert update(file_store, "count", Count, lambda _: None) == Count(of=3)
    assert file_store.etag("count") == etag


def test_what_is_no_such_document_is_not_written_over(file_store: Store) -> None:
    file_store.put("count", b"[]")
    with pytest.raises(ObjectCorrupt):
        update(file_store, "count", Count, one_more)
    assert file_store.get("count").body == b"[]"
