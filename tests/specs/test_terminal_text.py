"""What goes to a terminal does not steer it."""

import json
import sys
import unicodedata

from hypothesis import given
from hypothesis import strategies as st

from specs.untrusted_text import terminal_json, terminal_line, terminal_text

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
