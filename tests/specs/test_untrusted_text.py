"""Text of strangers steers no terminal and is no markup of a page."""

import json
import re
import sys
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.untrusted_text import artifact_key, escape_markdown, table_rows, terminal_json, terminal_line, terminal_text

UNSEEN = {"Cc", "Cf", "Zl", "Zp", "Cs"}


def test_every_character_that_steers_or_hides_is_left_out_and_no_other():
    everything = [chr(code) for code in range(sys.maxunicode + 1)]
    kept = set(terminal_text("".join(everything)))
    # What this Python's tables do not know yet (Cn) may be left out as well.
    steers = {each for each in everything if unicodedata.category(each) in UNSEEN} - {"\t", "\n"}
    assert kept & steers == set()
    assert {unicodedata.category(each) for each in everything if each not in kept} <= {*UNSEEN, "Cn"}


def test_colours_titles_and_text_that_runs_backwards_lose_their_power():
    assert terminal_text("\x1b[2J\x1b]0;owned\x07 \x9b31m a\u202eb\u2066c\rd\te\n") == "[2J]0;owned 31m abcd\te\n"


def test_a_line_stays_one_line():
    assert terminal_line("Failed\n\nSucceeded\r\n\teverything \u2028 passed") == "Failed Succeeded everything passed"


@given(st.text())
def test_json_means_the_same_and_steers_nothing(text: str):
    shown = terminal_json(json.dumps(text, ensure_ascii=False))
    assert json.loads(shown) == text
    assert terminal_text(shown) == shown


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


NAMES = st.text(st.sampled_from("ab-_A0"), max_size=12) | st.text(max_size=80)
WHAT = st.sampled_from(["gate", "worlds", "worlds-progress", "batch-results"])


def test_a_key_begins_with_the_documents_name():
    assert artifact_key("apartment-regression", "batch-results") == "apartment-regression--batch-results"


def test_what_belongs_to_no_document_has_no_name_in_its_key():
    assert artifact_key("", "reaped") == "reaped"


def test_a_name_that_prefect_takes_no_key_of_is_changed_and_has_its_digest():
    assert artifact_key("Night_ly", "gate") == "night-ly--5e91da3c5cbb7a84--gate"


@given(NAMES, WHAT)
def test_prefect_takes_every_key(name: str, what: str):
    key = artifact_key(name, what)
    assert re.fullmatch(r"[a-z0-9-]+", key)
    assert len(key) <= 48 + 2 + 16 + 2 + len(what)


@given(NAMES, WHAT, NAMES, WHAT)
def test_two_documents_or_two_things_never_have_the_same_key(name: str, what: str, other: str, more: str):
    assert (artifact_key(name, what) == artifact_key(other, more)) == ((name, what) == (other, more))
