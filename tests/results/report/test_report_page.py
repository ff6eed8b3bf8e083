"""The page: nothing in it but itself, nothing that a name could smuggle in, and readable by everybody."""

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.parity_audit import AuditReport
from specs.data.run_report import Verdict
from specs.pipeline.search_section import Distribution, Search
from specs.untrusted_text import escape_markdown
from tasks.results.report.batch_facts import Judgement, Link, RuleAnswer
from tasks.results.report.last_pictures import SeenPicture
from tasks.results.report.report_page import report_markdown, report_page, report_picture, report_styles
from tasks.results.statistics.failure_causes import Cause, CausePart, FailureCauses, FailureMap
from tasks.results.statistics.found_failures import BatchSearch, FoundFailure
from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.rare_failures import FailureProbability
from tests.factories.episodes import collided, crashed, passed, request
from tests.factories.reports import WORLDS, episodes, view
from tests.factories.worlds import apartment
from tests.results.estimands import blocks_without_estimand, intervals, without_estimand

EVIL = '<script>alert(1)</script><img src=x onerror="alert(1)">"\'&'
STYLES = report_styles()
VOID = frozenset({"meta", "link", "br", "img", "input"})


def some_causes() -> FailureCauses:
    """Returns the causes of failures of two variables, whose names are not what a page may hold as they are."""
    parts = tuple(
        CausePart(values=values, probability=often, interval=Interval(lower=0.5 * often, upper=2.0 * often))
        for values, often in zip(("below 0.2", *"23456789", "above 0.74"), (*[0.0] * 8, 0.001, 1 / 105), strict=True)
    )
    first = Cause(name=EVIL, share=0.62, interval=Interval(lower=0.55, upper=0.69), parts=parts, more=3)
    rows = [[10.0 ** -(9 - min(across, up)) for across in range(10)] for up in range(10)]
    return FailureCauses(
        causes=(first, first.model_copy(update={"name": "SIGMA", "share": 0.38})),
        told=0.97,
        map=FailureMap(across=EVIL, up="SIGMA", probability=tuple(map(tuple, rows)), failures=((0.9, 0.95),)),
    )


class Elements(HTMLParser):
    """Every element with its attributes and what it stands in, and the text between them."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"style", "title"} & set(self.open):
            self.text.append(data)


def elements(page: bytes) -> Elements:
    parser = Elements()
    parser.feed(page.decode())
    parser.close()
    assert parser.open == []
    return parser


def hostile(folder: Path) -> bytes:
    """Returns the page of a batch in which everything that somebody else names is an attack."""
    worlds = {name: apartment(name=EVIL, room_names=(EVIL, f"2{EVIL}")) for name in (f"wgj-1/{EVIL}", "wgj-1/b")}
    environment = {EVIL: f"0{EVIL}", "MAX_SPEED": "0.3"}
    launch = request(0).robot.model_copy(update={"name": EVIL, "version": EVIL, "launch_file": EVIL})
    requests = [
        request(index, world=list(worlds)[index % 2], environment=environment).model_copy(update={"robot": launch})
        for index in range(8)
    ]
    results = [
        crashed(index).model_copy(
            update={
                "failure_code": EVIL,
                "failure_reason": f"\x00\u202e{EVIL}",
                "rooms_entered": (EVIL,),
                "rooms_unreachable": (f"2{EVIL}\u202e",),
                "rooms_total": 3,
            }
        )
        for index in range(8)
    ]
    rules = tuple(RuleAnswer(name=EVIL, verdict="FAIL", sentence=EVIL) for _ in range(2))
    found = view(
        folder,
        requests,
        results,
        worlds=worlds,
        name=EVIL,
        why=EVIL,
        status="Failed",
        variables={EVIL: (f"0{EVIL}", None), "MAX_SPEED": ("0.3",)},
        metadata={"engine": EVIL, EVIL: EVIL},
        judgement=Judgement(verdict="FAIL", sentence=EVIL, at_least=0.5, confidence=0.9, rules=rules, ships=(EVIL,)),
        audit=AuditReport(verdict="SUSPECT", sentence=EVIL, engine=EVIL, compared=1),
        links=(Link(label=EVIL, href=EVIL),),
    )
    return report_page(found)


def test_the_same_batch_gives_the_same_bytes(tmp_path: Path):
    (tmp_path / "again").mkdir()
    assert report_page(view(tmp_path)) == report_page(view(tmp_path / "again"))


def test_no_name_becomes_markup(tmp_path: Path):
    found = elements(hostile(tmp_path))
    assert not {"script", "img"} & {tag for tag, _ in found.found}
    assert not [name for _, attributes in found.found for name in attributes if name.startswith("on")]
    assert "".join(found.text).count("<script>alert(1)</script>") > 30


def test_no_name_turns_the_text_around_it_or_breaks_the_file(tmp_path: Path):
    page = hostile(tmp_path).decode()
    assert "\u202e" not in page
    assert "\x00" not in page


def in_rooms(index: int, *unreachable: str) -> EpisodeResult:
    entered = ("Hall", "Kitchen") if unreachable else ("Hall", "Kitchen", "Bedroom")
    known = {"rooms_entered": entered, "rooms_unreachable": unreachable, "rooms_total": 3}
    return passed(index).model_copy(update=known)


def test_a_batch_that_was_kept_out_of_a_room_says_so_before_its_numbers(tmp_path: Path):
    page = report_page(view(tmp_path, [request(0)], [in_rooms(0, "Bedroom")])).decode()
    alarm = page.index('<p class="alarm">The robot cannot get to 1 of 3 rooms')
    assert alarm < page.index('<dl class="tiles">') < page.index("<b>Rooms entered: 2 of 3.</b>")
    assert '<td class="number">2 of 3</td>\n<td>Hall, Kitchen</td>\n<td>Bedroom</td>' in page


def test_a_batch_that_was_in_all_rooms_warns_of_nothing(tmp_path: Path):
    page = report_page(view(tmp_path, [request(0)], [in_rooms(0)])).decode()
    assert "<b>Rooms entered: 3 of 3.</b>" in page
    assert 'class="alarm"' not in page


def test_it_refers_to_nothing_outside(tmp_path: Path):
    page = report_page(view(tmp_path)).decode()
    loaded = [
        value
        for tag, attributes in elements(page.encode()).found
        for name, value in attributes.items()
        if name in {"src", "srcset", "data", "poster"} or (name == "href" and tag in {"link", "use", "image"})
    ]
    assert all(value is not None and value.startswith(("#", "data:")) for value in loaded)
    assert "url(" not in page
    assert "@import" not in page
    assert "<script" not in page


def test_its_own_policy_forbids_scripts_and_requests(tmp_path: Path):
    (policy,) = [
        attributes["content"]
        for _, attributes in elements(report_page(view(tmp_path))).found
        if attributes.get("http-equiv") == "Content-Security-Policy"
    ]
    assert policy is not None
    assert policy.startswith("default-src 'none'; style-src 'unsafe-inline'; img-src data:;")


@pytest.mark.parametrize("verdict", ["PASS", "FAIL", "INCONCLUSIVE"])
def test_the_verdict_is_a_word_and_a_sign_and_comes_before_all_numbers(verdict: Verdict, tmp_path: Path):
    judgement = Judgement(verdict=verdict, sentence=f"{verdict}: for a reason", at_least=0.9, confidence=0.95)
    page = report_page(view(tmp_path, judgement=judgement)).decode()
    heading = re.search(rf"<h2><svg.*?</svg>\s*{verdict}</h2>\s*<p>for a reason</p>", page, re.DOTALL)
    assert heading is not None
    assert heading.end() < page.index("Success rates</h2>")


def test_a_batch_that_nobody_judged_says_so(tmp_path: Path):
    page = report_page(view(tmp_path, judgement=None)).decode()
    assert "Not judged</h2>" in page
    assert "No gate has judged this batch" in page
    assert "asked for" not in page


def test_each_of_several_rules_has_its_verdict_and_its_sentence(tmp_path: Path):
    rules = (
        RuleAnswer(name="successRate", verdict="PASS", sentence="PASS: enough passed"),
        RuleAnswer(name="collisionRate", verdict="INCONCLUSIVE", sentence="INCONCLUSIVE: too few to tell"),
    )
    judged = Judgement(verdict="INCONCLUSIVE", sentence="one is open", at_least=0.9, confidence=0.95, rules=rules)
    text = "".join(elements(report_page(view(tmp_path, judgement=judged))).text)
    assert "Of 2 rules, 1 says INCONCLUSIVE, 1 says PASS." in text
    assert "PASS successRate: enough passed" in text
    assert "INCONCLUSIVE collisionRate: too few to tell" in text


def test_no_line_begins_with_the_sign_of_a_percentage(tmp_path: Path):
    open_one = RuleAnswer(name="collisionRate", verdict="INCONCLUSIVE", sentence="INCONCLUSIVE: too few to tell")
    failed = RuleAnswer(name="successRate", verdict="FAIL", sentence="FAIL: 0 of 8 (0.0 %, 90 % interval)")
    judged = Judgement(verdict="FAIL", sentence="0 of 8", at_least=0.9, confidence=0.9, rules=(failed, open_one))
    text = "".join(elements(report_page(view(tmp_path, judgement=judged))).text)
    assert "0 of 8 (0.0\u00a0%, 90\u00a0% interval)" in text


def test_where_two_versions_drove_it_is_said_which_one_was_judged(tmp_path: Path):
    both = Judgement(verdict="PASS", sentence="PASS: good", at_least=0.9, confidence=0.95, alone="courier version 2")
    text = "".join(elements(report_page(view(tmp_path, judgement=both))).text)
    assert "The verdict is about courier version 2 alone." in text
    assert "The verdict is about" not in report_page(view(tmp_path)).decode()


@pytest.mark.parametrize(("verdict", "heading"), [("PASS", "What ships:"), ("FAIL", "What would have shipped:")])
def test_what_ships_is_said_below_the_verdict_with_what_was_not_simulated(
    verdict: Verdict, heading: str, tmp_path: Path
):
    lines = ("courier version 3 for X86_64: simulated", "courier version 3 for ARM64: NOT SIMULATED")
    judged = Judgement(verdict=verdict, sentence=f"{verdict}: so", at_least=0.9, confidence=0.95, ships=lines)
    text = "".join(elements(report_page(view(tmp_path, judgement=judged))).text)
    assert heading in text
    assert all(line in text for line in lines)
    assert "ship" not in "".join(elements(report_page(view(tmp_path))).text)


def test_the_interval_beside_the_verdict_is_the_one_that_was_judged_by(tmp_path: Path):
    judged = Judgement(
        verdict="FAIL",
        sentence="FAIL: certain",
        at_least=0.9,
        confidence=0.9,
        rate=0.25,
        interval=Interval(lower=0.125, upper=0.5),
        method="repeated confidence interval",
    )
    page = report_page(view(tmp_path, judgement=judged, looks=12)).decode()
    said = "25.0\u00a0%, 90\u00a0% interval (repeated confidence interval) 12.5 to 50.0\u00a0% in these 2 worlds"
    assert f"{said}; 90 % asked for</desc>" in page
    assert "as soon as the gate was certain, at any of 12 looks: each interval holds at all of them." in page
    assert "might have ended" not in report_page(view(tmp_path)).decode()


@pytest.mark.parametrize("where", ["in these 2 worlds", "in worlds like these 2"])
def test_every_interval_says_of_which_worlds_it_is(where: str, tmp_path: Path):
    judged = Judgement(
        verdict="FAIL",
        sentence="FAIL: certain",
        at_least=0.9,
        confidence=0.9,
        rate=0.25,
        interval=Interval(lower=0.125, upper=0.5),
        method="some",
        over_worlds="like" in where,
    )
    found = view(tmp_path, judgement=judged)
    page = report_page(found)
    assert f"12.5 to 50.0\u00a0% {where}" in page.decode()
    assert intervals(page.decode()) > 2 * found.family.size
    assert blocks_without_estimand(page) == []
    assert without_estimand(report_picture(found).decode().replace("</text>", "\n\n")) == []


def test_the_page_says_how_many_intervals_it_shows_and_what_that_means(tmp_path: Path):
    found = view(tmp_path)
    page = report_page(found).decode()
    assert found.family.size == sum(len(table.rows) for column in found.columns for table in column)
    assert f"<b>{found.family.size} intervals of groups; all {found.family.size} hold together in 95\u00a0%" in page
    assert "so that in the mean 0.2 of them miss.</b>" in page


def test_it_says_what_the_episodes_tell_of_worlds_that_were_not_drawn(tmp_path: Path):
    page = report_page(view(tmp_path)).decode()
    assert "Worlds differ (ICC 1.00, design effect 5.2): these 10 episodes tell as much" in page
    assert "The rate in worlds like these 2: 95\u00a0% interval " in page
    early = Judgement(verdict="FAIL", sentence="FAIL: certain", at_least=0.9, confidence=0.9)
    page = report_page(view(tmp_path, judgement=early, looks=12)).decode()
    assert "Nothing is said of the rate in worlds like these 2: the batch might have ended early." in page


def test_an_alarming_audit_stands_beside_the_verdict(tmp_path: Path):
    audit = AuditReport(verdict="SUSPECT", sentence="outcomes flip", engine="planar")
    page = report_page(view(tmp_path, audit=audit)).decode()
    assert page.index("The parity audit is SUSPECT:") < page.index("Success rates</h2>")
    assert "The parity audit is" not in report_page(view(tmp_path)).decode()


def test_each_listed_failure_has_its_command(tmp_path: Path):
    page = report_page(view(tmp_path)).decode()
    commands = re.findall(r"simyard replay (\S+?)</code>", page)
    assert commands == [f"arn:simyard:simulation-job:0123456789ab:simb-1/{index}" for index in (1, 3, 7, 9)]


def test_what_a_search_found_is_told_with_the_command_that_drives_each_failure(tmp_path: Path):
    failures = tuple(
        FoundFailure(
            world=WORLDS[0],
            seed=seed,
            environment={"MAX_SPEED": EVIL},
            reason="collision",
            replayed="collision",
            reference="timeout" if seed < 11 else "",
            alike=17,
        )
        for seed in range(12)
    )
    search = BatchSearch(
        batch="simb-1",
        search=Search(over={"MAX_SPEED": Distribution(uniform=(0.2, 0.8))}),
        probability=FailureProbability(
            estimate=0.001,
            interval=Interval(lower=0.0007, upper=0.0014),
            highest=0.0014,
            method="splitting",
            why="about 1 in 1,000 fails",
            episodes=20_000,
        ),
        failures=failures[:11],
        vanished=failures[11:],
        failed=340,
        causes=some_causes(),
    )
    found = report_page(view(tmp_path, search=search)).decode()
    assert "fails with probability 0.001 (0.0007 to 0.0014), by 20,000 episodes of multilevel splitting" in found
    assert found.count("--found ") == 12
    reported, vanished = found.split("Vanished when driven again")
    assert "340 episodes failed; 11 of them, unlike each other, fail again; 1 more vanished" in reported
    assert reported.count("On C MuJoCo: <b>timeout</b>") == 11
    assert "On C MuJoCo: <b>passed</b>" in vanished
    assert "simyard replay arn:simyard:simulation-job-batch:0123456789ab:simb-1 --found 12" in vanished
    assert EVIL not in found
    assert "which is which in 97 of 100" in found
    assert "<b>62 %</b><small>55 to 69 %</small>" in found.replace("\xa0", " ")
    assert "most at above 0.74: 1 in 105; 3 values are left out" in found
    assert found.count('<rect class="shade"') == 100
    assert found.count('fill-opacity="1.0"') == 1
    unknown = search.model_copy(update={"causes": FailureCauses(why="seeds decide")})
    assert "Not known: seeds decide." in report_page(view(tmp_path, search=unknown)).decode()
    assert 'id="search"' not in report_page(view(tmp_path)).decode()


def test_a_batch_without_failures_without_worlds_and_without_an_audit_is_a_page_too(tmp_path: Path):
    requests, _ = episodes(4)
    page = report_page(view(tmp_path, requests, [passed(index) for index in range(4)], worlds={}, audit=None))
    assert "No parity audit was made" in page.decode()
    assert "Where it happened" not in page.decode()
    assert "Why episodes did not pass" not in page.decode()


def test_a_batch_of_which_every_episode_was_canceled_is_a_page_too(tmp_path: Path):
    requests, results = episodes(12)
    canceled = [result.model_copy(update={"status": "Canceled"}) for result in results]
    assert "0 of 0" in report_page(view(tmp_path, requests, canceled, status="Canceled")).decode()


def headings(found: Elements) -> Iterator[int]:
    for tag, _ in found.found:
        if re.fullmatch("h[1-6]", tag):
            yield int(tag[1])


def test_headings_go_down_one_level_at_a_time(tmp_path: Path):
    levels = list(headings(elements(report_page(view(tmp_path)))))
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(below - above <= 1 for above, below in pairwise(levels))


def test_every_table_has_a_caption_and_every_head_a_scope(tmp_path: Path):
    found = elements(report_page(view(tmp_path))).found
    tags = [tag for tag, _ in found]
    assert tags.count("table") == tags.count("caption") > 3
    assert all(attributes.get("scope") in {"col", "row"} for tag, attributes in found if tag == "th")


def test_every_drawing_has_a_name_or_is_hidden_from_who_cannot_see_it(tmp_path: Path):
    found = elements(report_page(view(tmp_path))).found
    ids = {attributes["id"] for _, attributes in found if "id" in attributes}
    drawings = [attributes for tag, attributes in found if tag == "svg"]
    for attributes in drawings:
        named = (attributes.get("aria-labelledby") or "").split()
        assert attributes.get("aria-hidden") == "true" or (named and set(named) <= ids)


def test_no_id_comes_twice_and_every_link_within_the_page_leads_somewhere(tmp_path: Path):
    found = elements(report_page(view(tmp_path))).found
    ids = [attributes["id"] for _, attributes in found if "id" in attributes]
    assert len(ids) == len(set(ids))
    within = [str(attributes["href"]) for _, attributes in found if str(attributes.get("href", "")).startswith("#")]
    assert {link[1:] for link in within} <= set(ids)
    assert within[0] == "#main"


def palettes() -> dict[str, dict[str, str]]:
    """Returns the colours of the light, the dark and the printed page."""
    light, dark, printed = (
        dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{3,6})", block))
        for block in re.findall(r":root \{(.*?)\}", STYLES, re.DOTALL)
    )
    return {"light": light, "dark": {**light, **dark}, "print": {**light, **printed}}


def luminance(color: str) -> float:
    """Returns the relative luminance (WCAG 2.2)."""
    digits = color[1:] if len(color) == 7 else "".join(2 * digit for digit in color[1:])
    parts = [int(digits[begin : begin + 2], 16) / 255 for begin in (0, 2, 4)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: str, other: str) -> float:
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


WRITTEN = [
    *((text, ground) for text in ("text", "quiet", "link") for ground in ("page", "card")),
    *((text, f"{text}-soft") for text in ("pass", "fail", "open", "none")),
    *((text, f"{ground}-soft") for text in ("text", "quiet", "goal") for ground in ("pass", "fail", "open", "none")),
    *(
        (mark, ground)
        for mark in ("hit", "late", "stuck", "out", "person", "robot", "other")
        for ground in ("card", "room")
    ),
    *(("text", "track"), ("quiet", "room"), ("link", "open-soft")),
]


@pytest.mark.parametrize("palette", ["light", "dark", "print"])
@pytest.mark.parametrize(("text", "ground"), WRITTEN)
def test_text_stands_out_from_its_ground(palette: str, text: str, ground: str):
    colors = palettes()[palette]
    assert contrast(colors[text], colors[ground]) >= 4.5


def test_the_picture_is_xml_whatever_is_in_the_names(tmp_path: Path):
    worlds = {name: apartment(name=EVIL, room_names=(f"\x01{EVIL}", "\ud800")) for name in WORLDS}
    ET.fromstring(report_picture(view(tmp_path, worlds=worlds)))  # noqa: S314 - our own


def test_the_picture_shows_the_world_with_most_failures(tmp_path: Path):
    picture = report_picture(view(tmp_path)).decode()
    assert "FAIL</text>" in picture
    assert "world-2-1: 4 failures" in picture


def many(count: int) -> tuple[list[EpisodeRequest], list[str]]:
    worlds = [f"wgj-1/world-{number}" for number in range(40)]
    values = {"MAX_SPEED": "0.3"}
    return [request(index, world=worlds[index % 40], environment=values) for index in range(count)], worlds


@pytest.mark.long
def test_a_page_does_not_grow_with_the_batch(tmp_path: Path):
    line = tuple((float(t), t / 100 % 7, (t * t) % 37 / 10, 0.0) for t in range(600))
    requests, worlds = many(2_000)
    failed = collided(0).model_copy(update={"trajectory": line})
    results = [failed.model_copy(update={"index": index}) for index in range(len(requests))]
    page = report_page(
        view(
            tmp_path,
            requests,
            results,
            worlds={name: apartment(name=name.partition("/")[2]) for name in worlds},
        )
    )
    assert page.count(b'<path class="way"') == 24 * 24
    assert len(page) < 2_000_000


URL = "file:///tmp/report.html"


def test_it_begins_with_the_verdict_and_ends_with_where_the_page_is(tmp_path: Path):
    text = report_markdown(view(tmp_path), URL)
    assert text.startswith("# ❌ FAIL\n\nFAIL: too few passed\n\n60.0")
    assert text.endswith(f"Report: {URL}")


def test_every_line_of_its_table_has_as_many_cells(tmp_path: Path):
    lines = [line for line in report_markdown(view(tmp_path), URL).splitlines() if line.startswith("|")]
    assert len(lines) > 5
    assert {line.count(" | ") for line in lines} == {4}


def test_it_says_when_nobody_judged_and_when_nothing_failed(tmp_path: Path):
    text = report_markdown(view(tmp_path, [], [], judgement=None), URL)
    assert "# Not judged" in text
    assert "No failures." in text


def test_it_warns_of_rooms_that_the_robot_was_kept_out_of(tmp_path: Path):
    known = {"rooms_entered": ("Hall", "Attic"), "rooms_unreachable": ("<b>",), "rooms_total": 3}
    kept_out = passed(0).model_copy(update=known)
    text = report_markdown(view(tmp_path, [request(0)], [kept_out]), URL)
    assert "Rooms entered: 2 of 3." in text
    assert "- ⚠️ The robot cannot get to 1 of 3 rooms" in text
    assert "<b>" not in text


def test_no_name_becomes_markdown(tmp_path: Path):
    evil = "<b>|[x](y)`\n# z"
    failed = crashed(0).model_copy(update={"failure_code": evil})
    text = report_markdown(view(tmp_path, [request(0)], [failed], name=evil), URL)
    assert "<b>" not in text
    assert "[x](y)" not in text
    assert "\n# z" not in text
    assert escape_markdown("a_b | c") == "a\\_b \\| c"


def test_several_rules_are_a_list_under_what_they_come_to(tmp_path: Path):
    told = Judgement(verdict="FAIL", sentence="FAIL: of 2 rules\nFAIL: few\nPASS: none", at_least=0.9, confidence=0.95)
    text = report_markdown(view(tmp_path, judgement=told), URL)
    assert text.startswith("# ❌ FAIL\n\nFAIL: of 2 rules\n- FAIL: few\n- PASS: none\n\n60.0")


def test_it_says_how_many_intervals_it_shows_and_of_which_worlds_each_is(tmp_path: Path):
    text = report_markdown(view(tmp_path), URL)
    assert "4 intervals of groups; all 4 hold together in 95 % of such reports" in text
    assert intervals(text) == 4 + 3
    assert without_estimand(text) == []


def test_what_a_robot_saw_last_stands_beside_its_failure_with_what_it_shows(tmp_path: Path):
    plain = view(tmp_path)
    (first, *others), url = plain.maps, "data:image/png;base64,iVBORw0KGgo="
    seen = (SeenPicture(url=url, label="depth, light 0 m to dark 2.0 m", when="7.50 s"),)
    listed = (first.listed[0].model_copy(update={"seen": seen}), *first.listed[1:])
    page = report_page(plain.model_copy(update={"maps": (first.model_copy(update={"listed": listed}), *others)}))
    found = elements(page)
    assert [attrs for tag, attrs in found.found if tag == "img"] == [{"src": url, "alt": seen[0].label}]
    assert {"7.50 s", "What it saw last: depth, light 0 m to dark 2.0 m."} <= set(found.text)
    assert b"<img" not in report_page(plain)
