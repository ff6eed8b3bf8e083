import json
import math

import pytest

from specs.digest import canonical_document, canonical_json, digest
from specs.field_types import OutputLocation


def test_canonical_json_is_sorted_compact_and_utf_8():
    assert canonical_json({"b": 1, "a": ["ü", None]}) == '{"a":["ü",null],"b":1}'.encode()


def test_canonical_json_reads_back_as_it_was():
    document = {"a": {"c": [1, 2.5, True]}, "b": "x"}

    assert json.loads(canonical_json(document)) == document  # pyright: ignore[reportArgumentType] - JSON, as a literal


def test_what_json_has_no_words_for_is_refused():
    with pytest.raises(ValueError, match="not JSON compliant"):
        canonical_json({"a": math.nan})


def test_absent_fields_do_not_count():
    assert canonical_document(OutputLocation(s3Bucket="abc", s3Prefix=None)) == {"s3Bucket": "abc"}
    assert digest(OutputLocation(s3Bucket="abc")) == digest(OutputLocation(s3Bucket="abc", s3Prefix=None))
    assert len(digest(OutputLocation())) == 64
