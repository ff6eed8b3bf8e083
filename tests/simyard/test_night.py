"""A document's nights for Python: each with its rate, and where the rate changed."""

import simyard
from simyard.answer.run_answers import Trend
from tasks.results.trend.trend_series import Choice, make_trend
from tasks.results.trend.trend_view import trend_page, trend_view
from tests.results.trend.histories import history


def trend_of(nights: int, drop_at: int = 0, drop: float = 0.3) -> Trend:
    found = make_trend(history(nights, drop_at, drop), Choice())
    view = trend_view(found, document="<nightly>", words="passed", chosen="", first=0, base="", limit=365.0)
    return Trend(view, trend_page(view))


def test_a_notebook_shows_the_newest_nights_and_how_many_there_are():
    found = trend_of(40)
    assert repr(found) == f"<Trend of '<nightly>': passed, 40 nights, {len(found.alarms)} changes>"
    shown = found._repr_html_()
    assert found.nights[0].day in shown
    assert "and 16 more nights; .page has them" in shown
    assert "<nightly>" not in shown


def test_a_change_is_named_above_the_nights():
    found = trend_of(40, drop_at=20)
    assert found.alarms[0].fell
    assert "lower</span>" in found._repr_html_()
    assert found.alarms[0].bundle_name in found._repr_html_()


def test_the_name_is_offered():
    assert callable(simyard.trend)
