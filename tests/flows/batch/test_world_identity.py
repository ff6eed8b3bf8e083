"""Worlds are the same if all that is in them is, whatever their generation is called."""

from flows.batch.world_identity import world_differences, world_identities
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tests.factories.batches import put_worlds
from tests.factories.simulations import pen


def test_worlds_of_two_generations_are_told_alike_by_their_content(file_store: Store):
    digests = put_worlds(file_store, {"one/a": pen(4.5, 0), "two/a": pen(4.5, 0), "two/b": pen(4.5, 1)})
    found = world_identities(file_store, digests)
    assert found["one/a"] == found["two/a"] != found["two/b"]


def test_a_world_that_is_gone_is_told_by_its_whole_document(file_store: Store):
    assert world_identities(file_store, {"one/gone": "a" * 64}) == {"one/gone": "a" * 64}


def test_a_world_that_is_not_what_it_was_is_told_by_what_it_was(file_store: Store):
    digests = put_worlds(file_store, {"one/a": pen(4.5, 0), "two/a": pen(4.5, 1)})
    put_worlds(file_store, {"two/a": pen(4.5, 0)})
    assert world_identities(file_store, digests)["two/a"] == digests["two/a"]
    assert file_store.get(world_key("two", "a")).body


def test_worlds_of_one_generation_are_told_apart_by_their_names_and_none_is_read(file_store: Store):
    assert world_differences(file_store, {"one/a": "a" * 64, "one/b": "b" * 64}) == {}


def test_a_world_that_was_generated_twice_is_one(file_store: Store):
    digests = put_worlds(file_store, {"one/a": pen(4.5, 0), "two/a": pen(4.5, 0)})
    assert len(set(world_differences(file_store, digests).values())) == 1
