"""The report's page: one HTML file with its styles and drawings in it, that loads and runs nothing.

Whatever a document or an application names (worlds, variables, reasons) is escaped, and the page's own policy forbids
scripts and requests besides.
"""

import functools
import re

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from tasks.results.report.view import View

# What XML cannot hold, and what turns the direction of the text around it.
_UNFIT = re.compile("[^\t\n\r\x20-\x7e\xa0-\u2029\u202f-\u2065\u206a-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def report_page(view: View) -> bytes:
    """Returns the page, the same bytes for the same view."""
    return _templates().get_template("report.html.j2").render(view=view).encode()


def report_picture(view: View) -> bytes:
    """Returns the rate with its interval and the first map as one SVG image, for where no page can stand."""
    return _templates().get_template("picture.svg.j2").render(view=view).encode()


@functools.cache
def _templates() -> Environment:
    return Environment(
        loader=PackageLoader("tasks.results.report"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_fit,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def _fit(value: object) -> object:
    return _UNFIT.sub("\ufffd", value) if isinstance(value, str) and not isinstance(value, Markup) else value
