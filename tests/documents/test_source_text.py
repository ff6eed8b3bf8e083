import json
from pathlib import Path

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from specs.errors import DocumentError
from tasks.documents.source_text import MAX_BYTES, decode_source_text, read_document

JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**60), 2**60)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda below: st.lists(below, max_size=3) | st.dictionaries(st.text(), below, max_size=3),
    max_leaves=10,
)


def fault(body: str | bytes, source: str = "a.yaml") -> tuple[str, str, str]:
    raw = body.encode() if isinstance(body, str) else body
    with pytest.raises(DocumentError) as caught:
        decode_source_text(raw, source)
    (one,) = caught.value.faults
    assert caught.value.source == source
    return one.path, one.value, one.allowed


@given(JSON)
def test_json_is_read_as_it_was_written(data: object):
    assert decode_source_text(json.dumps(data).encode(), "a.json") == data


@given(st.dictionaries(st.text(), st.text()))
@example({"<<": ""})
@example({"=": "", "": "~"})
def test_quoted_yaml_is_read_as_it_was_written(data: dict[str, str]):
    assert decode_source_text(yaml.dump(data, default_style='"').encode(), "a.yaml") == data


def test_words_and_dates_and_odd_numbers_are_text_in_yaml():
    assert decode_source_text(b"[no, on, 010, 1_000, 0x1f, 2026-11-21, 1:30, .nan]", "a.yaml") == [
        "no",
        "on",
        "010",
        "1_000",
        "0x1f",
        "2026-11-21",
        "1:30",
        ".nan",
    ]


def test_numbers_truth_and_nothing_are_what_json_says_they_are():
    found = decode_source_text(b"[1, -2, 0.5, 1e3, true, false, null, '1', \"true\"]", "a.yaml")

    assert repr(found) == repr([1, -2, 0.5, 1000.0, True, False, None, "1", "true"])


@pytest.mark.parametrize(
    ("body", "place", "value"),
    [
        ("a: &x 1", "line 1, column 4", "the anchor &x"),
        ("a: *x", "line 1, column 4", "the alias *x"),
        ("a: !!str 1", "line 1, column 4", "the tag tag:yaml.org,2002:str"),
        ("a: !!python/name:os.system", "line 1, column 4", "the tag tag:yaml.org,2002:python/name:os.system"),
        ("<<: {a: 1}", "line 1, column 1", "a merge key"),
        ("a: 1\na: 2", "line 2, column 1", "the key a for the second time"),
        ("b: {a: 1, a: 1}", "line 1, column 11", "the key a for the second time"),
        ("1: a", "line 1, column 1", "the key 1"),
        ("a: 1\n---\nb: 2", "line 2, column 1", "a second document"),
        ("[" * 41 + "]" * 41, "line 1, column 41", "too deeply nested"),
        ("a: [1,", "line 2, column 1", "did not find expected node content"),
        ("a:\n\tb: 1", "line 2, column 1", "a tab"),
        ("a: 1\n b: 2", "line 2, column 3", "a second colon before a space"),
        ("a:\n  b: 1\n c: 2", "line 3, column 2", "did not find expected key"),
        ("a: " + "9" * 5000, "line 1, column 4", "a number of 5000 digits"),
        ("a: 1e999", "a", "inf"),
    ],
)
def test_yaml_that_is_more_than_a_notation_for_json_is_refused(body: str, place: str, value: str):
    assert fault(body)[:2] == (place, value)


@pytest.mark.parametrize(
    ("body", "place", "value"),
    [
        ('{"a": 1, "a": 1}', "a", "occurs twice in one object"),
        ('{"a": NaN}', "file", "NaN"),
        ('{"a": {"b": [-1e999]}}', "a.b[0]", "-inf"),
        ('["\\ud800"]', "document[0]", "'\\ud800'"),
        ("[" * 100_000, "file", "too deeply nested"),
        ("[" * 41 + "]" * 41, "document", "too deeply nested"),
        ("{", "line 1, column 2", "Expecting property name enclosed in double quotes"),
        ("9" * 5000, "file", "a number of thousands of digits"),
    ],
)
def test_json_that_is_not_plain_is_refused(body: str, place: str, value: str):
    assert fault(body, "a.json")[:2] == (place, value)


def test_json_is_read_as_json_whatever_its_file_is_called():
    assert decode_source_text(b'{"who": "\\ud83e\\udd16"}', "text") == {"who": "\U0001f916"}


def test_a_document_of_more_than_a_mebibyte_is_refused():
    assert decode_source_text(b"#" * MAX_BYTES, "a.yaml") is None
    assert fault(b"#" * (MAX_BYTES + 1))[1] == "more than 1,048,576 bytes"


def test_bytes_that_are_not_utf_8_are_refused_with_their_place():
    assert fault(b"a: \xff") == ("file", "byte 3 is not UTF-8", "text in UTF-8")


def test_a_byte_order_mark_is_skipped(tmp_path: Path):
    (tmp_path / "a.yaml").write_bytes(b"\xef\xbb\xbfa: 1")

    assert read_document(tmp_path / "a.yaml") == {"a": 1}


@pytest.mark.parametrize(("name", "value"), [("missing.yaml", "there is no such file"), ("", "it is a folder")])
def test_a_path_that_is_no_file_is_refused(tmp_path: Path, name: str, value: str):
    with pytest.raises(DocumentError) as caught:
        read_document(tmp_path / name)

    assert [(one.path, one.value) for one in caught.value.faults] == [("file", value)]
    assert str(tmp_path / name) in str(caught.value)


def test_an_endless_file_is_refused_after_a_mebibyte():
    with pytest.raises(DocumentError, match="more than 1,048,576 bytes"):
        read_document(Path("/dev/zero"))
