from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.errors import DocumentError
from tasks.storage.base import keys

_DIGEST = "0123456789abcdef" * 4


@given(st.text(max_size=80))
def test_whatever_a_document_names_stays_inside_the_store(name: str) -> None:
    try:
        key = keys.world_key(name, name)
    except DocumentError:
        return
    inside = Path("/store", key).resolve()
    assert inside == Path("/store", "worlds", name, f"{name}.json")


@given(st.text(alphabet="./\\ab\0 ", max_size=12))
def test_a_key_that_passes_cannot_leave_the_store_or_be_hidden_in_it(key: str) -> None:
    try:
        keys.checked_key(key)
    except DocumentError:
        return
    parts = Path("/store", key).resolve().relative_to("/store").parts
    assert parts
    assert not any(part.startswith(".") for part in parts)


@pytest.mark.parametrize("name", ["", "-a", "_a", "a.b", "a/b", "a b", "a\n", "ä", "a" * 65])
def test_what_is_no_name_is_refused_with_the_rule(name: str) -> None:
    with pytest.raises(DocumentError, match=r"robot: .*1 to 64 of A-Z"):
        keys.desired_key(name)


@given(st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", fullmatch=True))
def test_every_name_by_the_rule_is_taken(name: str) -> None:
    assert keys.checked_name(name) == name


def test_each_thing_has_a_key_of_its_own() -> None:
    made = [
        keys.STORE,
        keys.job_key("kind", "a"),
        keys.token_key("kind", "a"),
        keys.claim_key("kind", "a"),
        keys.template_key("a"),
        keys.world_key("a", "a"),
        keys.chunk_key("a", 0),
        keys.chunk_key("a", 1),
        keys.result_key("a", "a.json"),
        keys.bundle_key(_DIGEST),
        keys.application_key("kind", "a"),
        keys.fleet_key("a"),
        keys.robot_record_key("a"),
        keys.desired_key("a"),
        keys.reported_key("a"),
    ]
    assert len(set(made)) == len(made)
    assert all(keys.checked_key(key) == key for key in made)


@given(st.text(max_size=64), st.text(max_size=64))
def test_tokens_of_any_text_have_keys_that_differ_as_they_do(one: str, other: str) -> None:
    assert keys.checked_key(keys.token_key("kind", one))
    assert (keys.token_key("kind", one) == keys.token_key("kind", other)) == (one == other)


@given(st.integers(0, 999_998))
def test_chunks_sort_by_number(number: int) -> None:
    assert keys.chunk_key("batch", number) < keys.chunk_key("batch", number + 1)


@pytest.mark.parametrize("digest", ["", "abc", _DIGEST.upper(), f"{_DIGEST}0", "../x"])
def test_what_is_no_digest_is_refused(digest: str) -> None:
    with pytest.raises(DocumentError, match="64 lower-case hex digits"):
        keys.bundle_key(digest)


@pytest.mark.parametrize("name", ["", ".hidden", "a/b", "../a"])
def test_what_is_no_file_name_is_refused(name: str) -> None:
    with pytest.raises(DocumentError, match="plain file name"):
        keys.result_key("batch", name)


@pytest.mark.parametrize("prefix", ["nightly/run", "/nightly/run", "nightly/run/", "//nightly/run//"])
def test_slashes_around_a_prefix_do_not_matter(prefix: str) -> None:
    assert keys.output_key(prefix, "a.zip") == "nightly/run/a.zip"


@pytest.mark.parametrize("prefix", [None, "", "/"])
def test_no_prefix_puts_outputs_at_the_top(prefix: str | None) -> None:
    assert keys.output_key(prefix, "a.zip") == "a.zip"


def test_a_prefix_that_climbs_is_refused() -> None:
    with pytest.raises(DocumentError):
        keys.output_key("nightly/../..", "a.zip")


@pytest.mark.parametrize("bucket", ["abc", "a-b.c", "0" * 63])
def test_buckets_by_s3s_rules_are_taken(bucket: str) -> None:
    assert keys.checked_bucket(bucket) == bucket


@pytest.mark.parametrize("bucket", ["", "ab", "Abc", "a..b", "-abc", "abc-", "a/b", "0" * 64, "key:secret@host"])
def test_what_is_no_bucket_is_refused(bucket: str) -> None:
    with pytest.raises(DocumentError, match="s3Bucket"):
        keys.checked_bucket(bucket)
