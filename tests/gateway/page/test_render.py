"""Pages as HTML: what is in them is text, the style is the one that the policy names, times can be read."""

import base64
import hashlib
import math
import re
from html.parser import HTMLParser

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.gateway.page.content import Cell, Facts, Frame, Gallery, Page, Picture, Steps, Table, Text, tone_of
from tasks.gateway.page.render import age, moment, notice_html, page_html, page_style, sign_in_html, style_digest
from tasks.results.report.report_page import report_styles

FRAME = Frame("/", is_paused=False, signed_in="", now_s=1e9)
TEXTS = (
    "<script>x</script>",
    '"><img src=x onerror=y>',
    "' onmouseover='x",
    "</style><script>",
    "{{ 7 * 7 }}",
    "\u202e\x00",
)


def whole(text: str) -> Page:
    cell = Cell(text, "/x", text)
    table = Table(
        text, (text, text), ((cell, Cell(text, is_state=True)),), href="/x", steps=Steps(text, "/a", "/b"), note=text
    )
    gallery = Gallery(text, (Picture("/x.svg", text, text, "/x", text),), steps=Steps(text))
    trail, links = ((text, "/x"),), ((text, "/x"),)
    blocks = (table, Facts(text, ((text, cell),)), gallery, Text(text, text), Table(text, (text,), (), empty=text))
    return Page(text, text, text, text, trail, links, blocks, is_going=True)


class Elements(HTMLParser):
    """The elements of a page with the names of their attributes."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, frozenset[str]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, frozenset(name for name, _ in attrs)))


def elements(page: bytes) -> list[tuple[str, frozenset[str]]]:
    parser = Elements()
    parser.feed(page.decode())
    return parser.found


@pytest.mark.parametrize("text", TEXTS)
def test_a_text_stays_a_text_wherever_it_stands(text: str):
    assert elements(page_html(whole(text), FRAME)) == elements(page_html(whole("plain"), FRAME))
    assert elements(sign_in_html(text, text)) == elements(sign_in_html("plain", "plain"))
    assert elements(notice_html(text, text, text)) == elements(notice_html("plain", "plain", "plain"))


def test_a_text_is_no_template():
    assert b"{{ 7 * 7 }}" in page_html(whole("{{ 7 * 7 }}"), FRAME)


@given(st.text(max_size=30))
def test_any_text_can_stand_on_a_page(text: str):
    assert page_html(whole(text), FRAME).endswith(b"</html>")


def test_the_policys_digest_is_that_of_the_style_on_the_page():
    found = re.search(rb"<style>(.*?)</style>", page_html(whole("x"), FRAME), re.DOTALL)
    assert found is not None
    assert style_digest() == f"sha256-{base64.b64encode(hashlib.sha256(found[1]).digest()).decode()}"


def test_the_colours_are_the_reports():
    def colours(style: str) -> list[dict[str, str]]:
        blocks = re.findall(r":root \{(.*?)\}", style, re.DOTALL)
        return [dict(re.findall(r"--([a-z-]+): (#[0-9a-f]+)", block)) for block in blocks]

    ours, reports = colours(page_style()), colours(report_styles())
    assert len(ours) == len(reports) == 3  # light, dark, paper
    for mine, its in zip(ours, reports, strict=True):
        assert {name: mine[name] for name in mine if name in its} == {name: its[name] for name in mine if name in its}
        assert mine.keys() - its.keys() == {"going-soft"}


def test_columns_in_which_nothing_stands_are_left_out():
    table = Table("t", ("first", "empty", "last"), ((Cell("1"), Cell(), Cell("3")),))
    assert re.findall(rb">(first|empty|last)</th>", page_html(Page("t", blocks=(table,)), FRAME)) == [b"first", b"last"]


def test_words_are_not_broken_and_digests_are():
    row = (Cell("robot"), Cell("launching application"), Cell("version 3", small="4a5b" * 16))
    page = page_html(Page("t", blocks=(Table("t", ("a", "b", "c"), (row,)),)), FRAME).decode()
    assert re.findall(r'data-head="(.)" class="( words)?', page) == [("b", " words"), ("c", "")]


def test_a_page_loads_itself_again_only_while_something_is_under_way():
    going = Page("t", is_going=True)
    assert b"http-equiv" in page_html(going, FRAME)
    assert b"http-equiv" not in page_html(Page("t"), FRAME)
    assert b"http-equiv" not in page_html(going, Frame("/", is_paused=True, signed_in="", now_s=0))


@pytest.mark.parametrize(
    ("at_s", "text"),
    [
        (1e9, "now"),
        (1e9 - 1, "1 second ago"),
        (1e9 - 7300, "2 hours ago"),
        (1e9 + 60, "in 1 minute"),
        (0, "11,574 days ago"),
    ],
)
def test_an_age_has_one_unit(at_s: float, text: str):
    assert age(at_s, 1e9) == text


@pytest.mark.parametrize("at_s", [math.nan, math.inf, -math.inf, -1.0, 1e300])
def test_a_time_that_no_clock_shows_is_said_to_be_none(at_s: float):
    assert moment(at_s) == "an unknown time"
    assert age(at_s, 1e9) == ""


def test_a_status_has_a_colour_and_an_unknown_one_has_none():
    states = ("PASS", "Failed", "INCONCLUSIVE", "InProgress", "Canceled", "anything")
    assert [tone_of(each) for each in states] == ["good", "bad", "open", "going", "none", "none"]
