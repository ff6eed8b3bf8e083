"""Tables line up, and find their place in a document."""

import pytest

from benchmarks.harness import markdown, with_tables


def test_a_table_is_markdown_whose_columns_line_up() -> None:
    assert markdown([("name", "share"), ("a long name", "1 %"), ("b", "100 %")]).splitlines() == [
        "| name        | share |",
        "| ----------- | ----: |",
        "| a long name |   1 % |",
        "| b           | 100 % |",
    ]


def test_tables_replace_what_stood_in_their_place_and_nothing_else() -> None:
    document = "before\n<!-- speed -->\nold\n<!-- end of speed -->\nafter\n"
    once = with_tables(document, "speed", "new")
    assert once == "before\n<!-- speed -->\n\nnew\n\n<!-- end of speed -->\nafter\n"
    assert with_tables(once, "speed", "new") == once


@pytest.mark.parametrize("document", ["", "<!-- speed -->", "<!-- end of speed -->"])
def test_a_document_without_the_place_is_left_alone(document: str) -> None:
    with pytest.raises(ValueError, match="one <!-- speed --> and one"):
        with_tables(document, "speed", "new")
