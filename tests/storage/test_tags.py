"""Tags that lie beside a resource."""

from collections.abc import Mapping

import pytest

from specs.arn import Reference
from specs.errors import DocumentError, ResourceNotFound
from tasks.storage.base.keys import tags_key
from tasks.storage.base.store import Store
from tasks.storage.tags import Tags, are_in_record, change_tags, delete_tags, tags_of, with_tags, without_tags

WORLD = Reference(kind="world", path="wgj-0123456789abcdef/w")
BORN = {"team": "arms"}


def born() -> Tags:
    return BORN


def test_a_resource_that_nobody_tagged_has_the_tags_that_it_was_made_with(file_store: Store) -> None:
    assert tags_of(file_store, WORLD, BORN) == BORN
    assert tags_of(file_store, WORLD, None) == {}


def test_tags_are_added_to_those_and_taken_away(store: Store) -> None:
    change_tags(store, WORLD, born, with_tags({"kitchen": "small"}))
    assert tags_of(store, WORLD, BORN) == {"team": "arms", "kitchen": "small"}
    change_tags(store, WORLD, born, without_tags(["team", "never there"]))
    assert tags_of(store, WORLD, BORN) == {"kitchen": "small"}


def test_a_tag_of_the_same_key_is_overwritten(file_store: Store) -> None:
    change_tags(file_store, WORLD, born, with_tags({"team": "legs"}))
    assert tags_of(file_store, WORLD, BORN) == {"team": "legs"}


def test_a_51st_tag_is_refused_and_changes_nothing(file_store: Store) -> None:
    change_tags(file_store, WORLD, born, with_tags({f"k{number}": "" for number in range(49)}))
    with pytest.raises(DocumentError, match="at most 50"):
        change_tags(file_store, WORLD, born, with_tags({"one": "more"}))
    assert len(tags_of(file_store, WORLD, BORN)) == 50


@pytest.mark.parametrize("key", ["simyard:outcome", "Simyard:x"])
def test_what_simyard_says_of_a_job_cannot_be_tagged_or_untagged(key: str) -> None:
    with pytest.raises(DocumentError, match="reserved"):
        with_tags({key: "Passed"})
    with pytest.raises(DocumentError, match="reserved"):
        without_tags([key])


def test_of_two_changes_at_once_none_is_lost(file_store: Store) -> None:
    def other_first(tags: Tags) -> dict[str, str]:
        if "other" not in tags:
            change_tags(file_store, WORLD, born, with_tags({"other": "first"}))
        return {**tags, "mine": "second"}

    change_tags(file_store, WORLD, born, other_first)
    assert tags_of(file_store, WORLD, BORN) == {"team": "arms", "other": "first", "mine": "second"}


def test_nothing_is_left_of_the_tags_of_a_resource_that_goes_meanwhile(file_store: Store) -> None:
    looks = 0

    def gone_at_the_second_look() -> Mapping[str, str]:
        nonlocal looks
        looks += 1
        if looks > 1:
            raise ResourceNotFound([])
        return BORN

    with pytest.raises(ResourceNotFound):
        change_tags(file_store, WORLD, gone_at_the_second_look, with_tags({"a": "b"}))
    assert not file_store.exists(tags_key("world", WORLD.path))


def test_deleted_tags_are_those_of_its_birth_again(file_store: Store) -> None:
    change_tags(file_store, WORLD, born, with_tags({"a": "b"}))
    delete_tags(file_store, WORLD)
    assert tags_of(file_store, WORLD, BORN) == BORN


def test_what_changes_anyway_has_its_tags_in_its_record() -> None:
    assert are_in_record(Reference(kind="robot", path="r"))
    assert are_in_record(Reference(kind="world-template", path="wt-0123456789abcdef"))
    assert not are_in_record(Reference(kind="world-template", path="0" * 64))
    assert not are_in_record(WORLD)
