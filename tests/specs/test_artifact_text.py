"""What a stranger wrote is text on Prefect's pages, and nothing else."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.artifact_text import escape_markdown, table_rows

HOSTILE = (
    "<img src=x onerror=alert(1)>\n\n# PASS | [click](javascript:alert(1)) ![](https://evil.example/x.png) `x`\x1b[2J"
)


def test_markdown_and_html_are_escaped_in_one_line():
    assert escape_markdown(HOSTILE) == (
        r"\<img src=x onerror=alert\(1\)\> \# PASS \| \[click\]\(javascript:alert\(1\)\) "
        r"\!\[\]\(https://evil.example/x.png\) \`x\`\[2J"
    )


def test_a_cell_is_neither_a_link_nor_an_element():
    (row,) = table_rows([{"reason": HOSTILE, "group": "MAX_SPEED=0.4", "passed": 3, "rate": None}])
    assert row["reason"] == (
        r"\<img src=x onerror=alert(1)\> # PASS \| \[click\](javascript:alert(1)) "
        r"!\[\](https://evil.example/x.png) \`x\`\[2J"
    )
    assert (row["group"], row["passed"], row["rate"]) == ("MAX_SPEED=0.4", 3, None)


@given(st.text())
@pytest.mark.parametrize("character", "[]<>`|")
def test_whatever_is_written_stays_one_line_with_nothing_active(character: str, text: str):
    (row,) = table_rows([{"cell": text + character}])
    for escaped in (escape_markdown(text + character), str(row["cell"])):
        assert len(escaped.splitlines()) == 1
        assert escaped.count(character) == escaped.count(f"\\{character}")
