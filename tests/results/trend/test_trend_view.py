"""The trend's page: its charts are what the nights were, and nothing in it loads, runs or follows a stranger's name."""

import re
from xml.etree import ElementTree as ET

import pytest

from specs.errors import DocumentError
from tasks.results.trend.trend_series import (
    MOST_SERIES,
    WHOLE,
    Choice,
    Night,
    day,
    make_trend,
    night_times,
    raised_alarms,
)
from tasks.results.trend.trend_view import TrendView, trend_page, trend_view
from tests.results.estimands import blocks_without_estimand, intervals
from tests.results.trend.histories import SPEEDS, WORLDS, history

BASE = "file:///store/buckets/results"
EVIL = '<script>alert(1)</script><img src=x onerror="alert(1)">'


def view(nights: list[Night], choice: Choice | None = None, first: int = 0) -> TrendView:
    trend = make_trend(nights, choice or Choice())
    return trend_view(trend, document="nightly", words="Success rate", chosen="", first=first, base=BASE, limit=365)


def test_a_drop_is_told_first_with_the_bundle_that_it_began_with():
    shown = view(history(60, drop_at=45))
    (alarm,) = [alarm for alarm in shown.alarms if alarm.series == "All episodes"]
    assert shown.standing
    assert (alarm.fell, alarm.began, alarm.new_bundle) == (
        True,
        "arn:simyard:simulation-job-batch:0123456789ab:simb-45",
        True,
    )
    assert alarm.bundle_name.startswith("courier ")
    assert "the first night of that bundle" in alarm.sentence
    page = trend_page(shown).decode()
    assert "<title>The rate fell: nightly, night by night</title>" in page
    assert page.index("▼ The rate fell") < page.index('id="chart"')


def test_where_all_episodes_fell_a_world_that_fell_later_is_no_alarm_of_its_own():
    shown = view(history(90, drop_at=45))
    whole = next(alarm for alarm in shown.alarms if alarm.series == "All episodes")
    assert all(alarm.seen_on <= whole.seen_on for alarm in shown.alarms)


def test_worlds_and_values_are_series_and_share_the_false_alarms():
    trend = make_trend(history(10), Choice())
    assert [(each.kind, each.label) for each in trend.series] == [
        ("all", "All episodes"),
        *(("world", name) for name in WORLDS),
        *(("MAX_SPEED", speed) for speed in SPEEDS),
    ]
    assert sum(1.0 / each.limit for each in trend.series) == pytest.approx(1.0 / 365.0)


def test_worlds_that_are_made_anew_each_night_are_no_series():
    nights = [each.model_copy(update={"worlds_made": str(at)}) for at, each in enumerate(history(6))]
    trend = make_trend(nights, Choice())
    assert {each.kind for each in trend.series} == {"all", "MAX_SPEED"}
    assert all(point and point.count.freedom == len(WORLDS) - 1 for point in trend.series[0].points)


def test_worlds_that_stay_make_no_dispersion():
    points = make_trend(history(6), Choice()).series[0].points
    assert [point.count.freedom for point in points if point] == [len(WORLDS) - 1, 0, 0, 0, 0, 0]


def test_no_more_series_are_looked_at_than_said():
    nights = history(3)
    many = [
        night.model_copy(
            update={"cells": tuple(c._replace(variables=(str(at),)) for at, c in enumerate(night.cells * 3))}
        )
        for night in nights
    ]
    trend = make_trend(many, Choice())
    assert len(trend.series) == MOST_SERIES + 1
    assert trend.left_out == len(WORLDS) + 48 - MOST_SERIES


def test_a_choice_leaves_the_other_episodes_out():
    shown = view(history(5), Choice(world="world-1-1", variables=(("MAX_SPEED", "0.4"),)))
    assert {row.episodes for row in shown.rows} == {24}


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        (Choice(world="kitchen"), "--world: 'kitchen': one of world-1-1"),
        (Choice(version="99"), "--version: '99': one of 2"),
        (Choice(variables=(("MAX_SPEED", "7"),)), "--variable: 'MAX_SPEED=7': one of MAX_SPEED=0.4"),
    ],
)
def test_a_choice_of_nothing_is_refused_with_what_there_is(choice: Choice, said: str):
    with pytest.raises(DocumentError, match=re.escape(said)):
        make_trend(history(3), choice)


def test_every_interval_is_of_the_worlds_of_its_night_and_the_page_says_so():
    nights = [each.model_copy(update={"worlds_made": str(at // 3)}) for at, each in enumerate(history(6))]
    shown = view(nights)
    assert {row.worlds for row in shown.rows} == {len(WORLDS)}
    assert [row.worlds for row in shown.bundles] == [2 * len(WORLDS)]
    page = trend_page(shown)
    assert f"in these {len(WORLDS)} worlds, " in page.decode()
    assert intervals(page.decode()) > 2 * 6
    assert blocks_without_estimand(page) == []


def test_fewer_nights_may_be_shown_and_all_are_tested():
    nights = history(60, drop_at=45)
    shown = view(nights, first=40)
    assert (shown.nights, len(shown.rows)) == (20, 20)
    assert shown.alarms[-1].began == view(nights).alarms[-1].began


def test_every_night_has_a_place_and_a_line_that_says_what_it_was():
    nights = history(12)
    nights[3] = nights[3].model_copy(update={"left_out": "its batch is Canceled", "cells": ()})
    nights[5] = nights[5].model_copy(update={"request": nights[4].request})
    chart = view(nights).whole
    assert chart
    assert [dot.kind for dot in chart.dots] == ["night"] * 3 + ["out", "night", "repeat"] + ["night"] * 6
    assert chart.dots[3].text.endswith("its batch is Canceled")
    assert chart.dots[0].href == "../simb-0/report.html"
    assert "drove the same as before" in chart.dots[5].text


@pytest.mark.parametrize("count", [1, 2, 40])
def test_the_page_loads_and_runs_nothing_and_escapes_names(count: int):
    nights = [
        each.model_copy(
            update={
                "variables": (EVIL,),
                "left_out": "",
                "cells": tuple(cell._replace(world=f"g/{EVIL}", variables=(EVIL,)) for cell in each.cells),
                "robots": tuple(robot.model_copy(update={"name": EVIL}) for robot in each.robots),
            }
        )
        for each in history(count, drop_at=20)
    ]
    page = trend_page(view(nights)).decode()
    assert "<script" not in page
    assert "<img" not in page
    assert "content=\"default-src 'none'" in page
    assert re.findall(r'(?:src|href)="(?!#|\.\./|data:,)', page) == []
    for svg in re.findall(r"<svg.*?</svg>\s*</div>", page, re.DOTALL):
        assert "NaN" not in svg
        assert "nan" not in re.sub(r"<title.*?</title>|<text.*?</text>|aria-label=\"[^\"]*\"", "", svg)


def test_the_headline_of_nights_without_a_change_says_so():
    page = trend_page(view(history(6))).decode()
    assert "<h2>No change</h2>" in page
    assert "No change of the rate was seen in 6 nights." in page


def test_a_history_without_a_night_that_counts_is_said():
    nights = [each.model_copy(update={"left_out": "its batch is Failed", "cells": ()}) for each in history(3)]
    page = trend_page(view(nights)).decode()
    assert "No night has a result that counts." in page
    assert page.count("no result that counts</td>") == 3


def test_the_drawing_is_well_formed():
    page = trend_page(view(history(40, drop_at=20))).decode()
    drawings = re.findall(r'<div class="chart.*?</div>', page, re.DOTALL)
    assert len(drawings) == 1 + len(WORLDS) + len(SPEEDS)
    for drawing in drawings:
        ET.fromstring(drawing)  # noqa: S314 - the page's own


def test_the_same_nights_give_the_same_bytes():
    assert trend_page(view(history(20))) == trend_page(view(history(20)))


@pytest.mark.parametrize(
    ("nights", "first", "days"), [(60, 0, (0, 29, 59)), (60, 20, (20, 39, 59)), (3, 0, (0, 2)), (1, 0, (0,))]
)
def test_the_first_the_middle_and_the_last_day_that_are_drawn_stand_below_the_chart(
    nights: int, first: int, days: tuple[int, ...]
):
    made = history(nights)
    chart = view(made, first=first).whole
    assert chart
    assert [mark.text for mark in chart.days] == [day(made[at].begun_at_s) for at in days]


def test_a_fall_that_others_saw_without_a_night_is_not_raised_by_it():
    trend = make_trend(history(60, drop_at=45), Choice())
    fall = next(change for each, change in trend.alarms() if each.label == WHOLE)
    assert raised_alarms(trend, Choice(), "run-20") == []
    assert fall in [change for _, change in raised_alarms(trend, Choice(), f"run-{fall.seen}")]


def test_nights_of_one_day_are_told_apart_by_hour_and_minute():
    made = history(3)
    close = [made[0], made[1].model_copy(update={"begun_at_s": made[0].begun_at_s + 60.0}), made[2]]
    first, second, alone = night_times(close).values()
    assert first != second
    assert first[:10] == second[:10] == day(made[0].begun_at_s)
    assert alone == day(made[2].begun_at_s)
