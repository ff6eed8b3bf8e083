"""Worlds are the same if all that is in them is, whatever their generation is called."""

from flows.alike_worlds import alike_worlds
from tasks.storage.store import Store
from tests.batches_factory import put_worlds
from tests.simulate_factory import pen


def test_worlds_of_two_generations_are_told_alike_by_their_content(file_store: Store):
    put_worlds(file_store, {"one/a": pen(4.5, 0), "two/a": pen(4.5, 0), "two/b": pen(4.5, 1)})
    found = alike_worlds(file_store, ["one/a", "two/a", "two/b", "two/a"])
    assert found["one/a"] == found["two/a"] != found["two/b"]


def test_a_world_that_is_gone_is_left_out(file_store: Store):
    assert alike_worlds(file_store, ["one/gone"]) == {}
