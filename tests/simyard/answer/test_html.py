"""HTML for a notebook: nothing of a stranger's becomes markup, and nothing is endless."""

from html.parser import HTMLParser

import pytest

from simyard.answer.html import MOST_ROWS, Html, badge, block, heading, link, paragraph, picture, table, text

EVIL = "<script>alert(1)</script>\" onload='x' &amp; \u202ertl\x00"


class Elements(HTMLParser):
    """The elements and attributes of a text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.names: list[str] = []
        self.attributes: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.append(tag)
        self.attributes += [name for name, _ in attrs]


def test_whatever_a_text_is_it_stays_a_text():
    shown = block(
        heading(EVIL, badge(EVIL), EVIL),
        paragraph(EVIL),
        table((EVIL,), [(EVIL,)], 1, EVIL),
        picture("<svg/>", EVIL, 10),
        link(f"file:///{EVIL}", EVIL),
        link('https://host/"><script>', EVIL),
    )
    found = Elements(shown)
    assert set(found.names) == {"div", "strong", "span", "p", "table", "thead", "tbody", "tr", "th", "td", "img", "a"}
    assert set(found.attributes) == {"style", "alt", "src", "href", "target", "rel"}
    assert "\u202e" not in shown
    assert "\x00" not in shown


@pytest.mark.parametrize("url", ["javascript:alert(1)", "data:text/html,x", "s3://bucket/key", "vbscript:x", EVIL])
def test_what_is_no_address_of_a_page_is_no_link(url: str):
    assert Elements(link(url, "there")).names == []
    assert Elements(link("file:///folder/report.html")).names == ["a"]


def test_a_long_text_is_cut():
    assert len(text("x" * 10_000)) == 300


def test_a_long_table_is_cut_and_says_so():
    shown = table(("number",), ((number,) for number in range(100)), 100, "; to_pandas() has all")
    assert Elements(shown).names.count("td") == MOST_ROWS
    assert f"and {100 - MOST_ROWS} more; to_pandas() has all" in shown


def test_a_drawing_is_an_image_whose_styles_stay_inside():
    assert Elements(picture("<svg><style>svg{fill:red}</style></svg>", "a plan", 700)).names == ["img"]


def test_a_drawing_that_is_too_large_is_told_instead():
    assert "a drawing of 5 MiB, which is too large for a notebook" in picture("x" * (5 << 20), "a plan", 700)


def test_a_cell_that_is_html_stays_html():
    assert "<b>x</b>" in table(("a",), [(Html("<b>x</b>"),)], 1)
