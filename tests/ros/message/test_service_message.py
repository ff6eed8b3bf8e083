"""Requests to RoboMaker's services, whole and broken."""

import contextlib
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.ros.message.ros_messages import read_keys, read_tags, text, write_outcome, write_tags

TAGS = st.dictionaries(st.text(max_size=20), st.text(max_size=20), max_size=8)


@given(tags=TAGS)
def test_tags_read_as_they_were_written(tags: dict[str, str]):
    assert read_tags(write_tags(tags)) == tags


@given(keys=st.lists(st.text(max_size=20), max_size=8))
def test_keys_read_as_they_were_written(keys: list[str]):
    assert read_keys(struct.pack("<I", len(keys)) + b"".join(map(text, keys))) == keys


@given(tags=TAGS, cut=st.integers(1, 400))
def test_a_list_that_ends_early_is_refused(tags: dict[str, str], cut: int):
    data = write_tags(tags)
    with pytest.raises(ValueError, match=r"list|text"):
        read_tags(data[: max(len(data) - cut, 0)] if cut <= len(data) else b"")


@given(data=st.binary(max_size=64))
def test_any_bytes_are_read_or_refused(data: bytes):
    with contextlib.suppress(ValueError):
        read_tags(data)


def test_a_list_that_claims_billions_of_tags_is_refused_at_once():
    with pytest.raises(ValueError, match="that ends after 0"):
        read_tags(struct.pack("<I", 2**32 - 1))


def test_an_outcome_is_a_byte_and_a_text():
    assert write_outcome(success=False, message="no") == b"\0\2\0\0\0no"
