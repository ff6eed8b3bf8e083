"""A reference to a block that cannot be followed is a fault of the parameters; a URL needs no server."""

import pytest

from flows.prefect.parameters import store_at
from specs.errors import DocumentError


@pytest.mark.parametrize("url", ["s3://bucket/prefix", "file:///folder", None])
def test_a_url_stays_as_it_is(url: str | None, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("SIMYARD_STORE", raising=False)
    assert store_at(url) == url


@pytest.mark.parametrize(
    "reference",
    [
        "block://",
        "block://s3-bucket",
        "block://s3-bucket/name/more",
        "block://aws-credentials/name",
        "block://gcs-bucket/name",
    ],
)
def test_another_form_is_refused_with_those_that_are_known(reference: str):
    with pytest.raises(DocumentError, match="block://s3-bucket/NAME, or block://aws-credentials/NAME/bucket/prefix"):
        store_at(reference)
