"""A token that comes again with another request: the message names what changed."""

import pytest
from pydantic import JsonValue

from specs.errors import IdempotentParameterMismatch
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import changes_text, submit


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ({"a": {"b": [1, 2]}}, {"a": {"b": [1, 3]}}, "a.b[1] was 2 and is 3"),
        ({"a": [1]}, {"a": [1, 2]}, "a was a list of 1 and is a list of 2"),
        ({}, {"a": "x"}, "a was nothing and is 'x'"),
        (
            {"a": 1, "b": 1, "c": 1, "d": 1},
            {},
            "a was 1 and is nothing, b was 1 and is nothing, c was 1 and is nothing, ...",
        ),
    ],
)
def test_the_first_fields_that_differ_are_told_with_both_values(before: JsonValue, after: JsonValue, said: str):
    assert changes_text(before, after) == said


def test_a_reused_token_names_the_field_that_changed(file_store: Store):
    submit(file_store, "simulation-job-batch", {"seeds": [1], "lanes": 8}, "batch-1")
    with pytest.raises(
        IdempotentParameterMismatch, match=r"'batch-1': came before .*: lanes was 8 and is 16; send the same one"
    ):
        submit(file_store, "simulation-job-batch", {"seeds": [1], "lanes": 16}, "batch-1")
