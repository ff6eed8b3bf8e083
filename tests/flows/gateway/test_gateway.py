"""What a request refers to."""

import pytest

from flows.gateway.gateway import ROBOMAKER_KINDS, path_of, referenced
from specs.errors import DocumentError, ResourceNotFound
from tasks.storage.base.store import Store


def test_an_arn_of_the_kind_gives_the_path_in_the_store(file_store: Store) -> None:
    assert path_of(file_store, "arn:simyard:robot:s:r1", "robot", "robot") == "r1"
    old = "arn:aws:robomaker:eu-west-1:123456789012:deployment-fleet/f/1600000000000"
    assert path_of(file_store, old, "deployment-fleet", "fleet") == "f"
    assert referenced(file_store, "arn:simyard:world:s:g/w", ROBOMAKER_KINDS, "resourceArn").path == "g/w"


@pytest.mark.parametrize(
    "text", ["arn:simyard:robot:s:r1", "arn:aws:sns:x:y:z", "arn:", "fleet", "arn:simyard:pipeline-run:s:run-1"]
)
def test_what_is_no_arn_of_the_kind_is_an_invalid_parameter(text: str, file_store: Store) -> None:
    with pytest.raises(DocumentError, match="fleet") as refused:
        path_of(file_store, text, "deployment-fleet", "fleet")
    assert type(refused.value) is DocumentError


@pytest.mark.parametrize("path", ["", "a/b", "../x", "a b", "x" * 65, "a:b"])
def test_what_nothing_can_be_called_is_not_found(path: str, file_store: Store) -> None:
    with pytest.raises(ResourceNotFound):
        path_of(file_store, f"arn:simyard:robot:s:{path}", "robot", "robot")


def test_a_world_has_two_names(file_store: Store) -> None:
    with pytest.raises(ResourceNotFound, match="not in the store"):
        path_of(file_store, "arn:simyard:world:s:g", "world", "world")
