"""Renders a trend as one HTML page that loads and runs nothing, in the report's colours and under its policy."""

from tasks.results.report.page import page_templates, report_styles
from tasks.results.trend.view import TrendView

_PACKAGE = "tasks.results.trend"


def trend_page(view: TrendView) -> bytes:
    """Returns the page, the same bytes for the same view."""
    styles = f"{report_styles()}\n{page_templates(_PACKAGE).get_template('trend.css').render().rstrip()}"
    return page_templates(_PACKAGE).get_template("trend.html.j2").render(view=view, styles=styles).encode()
