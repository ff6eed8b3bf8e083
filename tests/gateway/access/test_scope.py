"""What a key may be limited to."""

import pytest

from specs.arn import ResourceKind
from specs.errors import DocumentError
from tasks.gateway.access.access_keys import parse_scope

STORE = "0123456789abcdef"


@pytest.mark.parametrize(
    ("text", "path", "covered"),
    [
        ("deployment-fleet/home", "home", True),
        ("deployment-fleet/home", "home-2", False),
        ("deployment-fleet/home", "hom", False),
        ("deployment-fleet/home*", "home-2", True),
        ("deployment-fleet/*", "other", True),
        ("robot/home", "home", False),
        ("robot/*", "home", False),
        (f"arn:simyard:deployment-fleet:{STORE}:home", "home", True),
        (f"arn:simyard:deployment-fleet:{STORE}:*", "home", True),
        ("arn:simyard:deployment-fleet:another:home", "home", False),
        ("arn:aws:robomaker:us-east-1:123456789012:deployment-fleet/home/1600000000000", "home", True),
        ("arn:aws:robomaker:us-east-1:123456789012:deployment-fleet/ho*", "home", True),
    ],
)
def test_a_scope_covers_what_it_names(text: str, path: str, covered: bool) -> None:  # noqa: FBT001 - a case
    assert parse_scope(text).covers("deployment-fleet", path, STORE) is covered


@pytest.mark.parametrize(
    ("text", "kind", "whole"),
    [
        ("robot/*", "robot", True),
        ("robot/a*", "robot", False),
        ("robot/a", "robot", False),
        ("world/*", "robot", False),
        ("arn:simyard:robot:another:*", "robot", False),
    ],
)
def test_a_whole_kind_is_covered_by_an_asterisk_alone(text: str, kind: ResourceKind, whole: bool) -> None:  # noqa: FBT001
    assert parse_scope(text).covers_all(kind, STORE) is whole


@pytest.mark.parametrize(
    "text", ["", "*", "home", "fleet/home", "robot/", "robot/*a", "robot/a b", "arn:aws:s3:::b", "arn:"]
)
def test_a_text_that_names_nothing_is_refused(text: str) -> None:
    with pytest.raises(DocumentError, match="KIND/NAME"):
        parse_scope(text)
