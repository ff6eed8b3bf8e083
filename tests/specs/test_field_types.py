from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from specs.field_types import (
    Boolean,
    EnvironmentVariableMap,
    Integer,
    Number,
    OutputLocation,
    RobotTagMap,
    S3Bucket,
    TagMap,
    Text,
    Timestamp,
)

Kind = TypeAdapter[Any]


def refused(kind: Kind, value: object) -> bool:
    try:
        kind.validate_python(value)
    except ValidationError:
        return True
    return False


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (TypeAdapter(Text), 1),
        (TypeAdapter(Text), b"1"),
        (TypeAdapter(Integer), "1"),
        (TypeAdapter(Integer), True),
        (TypeAdapter(Integer), 1.0),
        (TypeAdapter(Number), "1"),
        (TypeAdapter(Number), True),
        (TypeAdapter(Number), float("nan")),
        (TypeAdapter(Number), float("inf")),
        (TypeAdapter(Timestamp), "2026-11-21"),
        (TypeAdapter(Boolean), 1),
        (TypeAdapter(Boolean), "yes"),
    ],
)
def test_text_numbers_and_truth_are_never_taken_for_each_other(kind: Kind, value: object):
    assert refused(kind, value)


def test_patterns_are_matched_from_end_to_end():
    assert not refused(TypeAdapter(S3Bucket), "my-bucket")
    assert refused(TypeAdapter(S3Bucket), "my-bucket\n")
    assert refused(TypeAdapter(S3Bucket), "xMy-bucket")


@pytest.mark.parametrize("key", ["aws:owner", "AWS:owner"])
def test_tags_that_begin_with_aws_are_reserved(key: str):
    assert refused(TypeAdapter(TagMap), {key: "x"})


@pytest.mark.parametrize("name", ["AWS_REGION", "speed", "1ST", "A-B", ""])
def test_variables_are_capitals_and_do_not_begin_with_aws(name: str):
    assert refused(TypeAdapter(EnvironmentVariableMap), {name: "x"})


def test_a_variable_needs_a_value():
    assert refused(TypeAdapter(EnvironmentVariableMap), {"SPEED": ""})
    assert not refused(TypeAdapter(EnvironmentVariableMap), {"_SPEED_2": "1"})


def test_tags_of_robots_must_fit_the_name_of_a_variable():
    assert refused(TypeAdapter(RobotTagMap), {"my-key": "x"})
    assert not refused(TypeAdapter(RobotTagMap), {"my_key1": "x"})


@pytest.mark.parametrize(
    "prefix", ["../..", "a/../b", "..", "./a", "a//b", "a\\b", "a\x00b", "a\tb", "a\u202eb", "a/.hidden"]
)
def test_a_prefix_stays_inside_its_bucket(prefix: str):
    with pytest.raises(ValidationError, match="a folder inside the bucket"):
        OutputLocation(s3Bucket="results", s3Prefix=prefix)


@pytest.mark.parametrize("prefix", ["nightly", "a/b=1/c d", "/nightly/", "/", "caf\u00e9", None])
def test_a_prefix_may_be_any_folder_with_or_without_slashes_around_it(prefix: str | None):
    assert OutputLocation(s3Bucket="results", s3Prefix=prefix).s3Prefix == prefix
