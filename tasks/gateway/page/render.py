"""Renders pages as HTML that runs nothing and asks nobody else; whatever stands on them is escaped.

Headers tell a browser what to refuse: for Simyard's own pages, and for what strangers have put into a store.
"""

import base64
import functools
import hashlib
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, cast

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from specs.untrusted_text import xml_text
from tasks.gateway.page.content import Block, Facts, Frame, Gallery, Page, Table, Text, tone_of

RELOAD_S = 5
_AGES = ((86_400, "day"), (3_600, "hour"), (60, "minute"), (1, "second"))
_ALWAYS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Robots-Tag": "noindex",
}
_STORED_CONTENT = "sandbox allow-downloads; default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_NOWHERE = "base-uri 'none'; frame-ancestors 'none'"


# The names, tags, reasons and documents in a store may be written by anybody. Each page has its style in itself, and
# the policy that comes with it allows that style by its digest, and no script.
def page_html(page: Page, frame: Frame) -> bytes:
    """Returns a page as HTML."""
    return _render("page.html.j2", page=page, frame=frame, reload_s=RELOAD_S)


def sign_in_html(back: str, reason: str) -> bytes:
    """Returns the form that asks for a key.

    Args:
        back: The address to go to afterwards.
        reason: Why it is asked again; empty the first time.
    """
    return _render("sign-in.html.j2", back=back, reason=reason)


def notice_html(title: str, sentence: str, go_to: str = "/", *, by_itself: bool = False) -> bytes:
    """Returns a page that says one thing, and where to go on.

    Args:
        title: The heading.
        sentence: What is said.
        go_to: The address of the link.
        by_itself: Whether the browser follows it at once.
    """
    return _render("notice.html.j2", title=title, sentence=sentence, go_to=go_to, by_itself=by_itself)


@functools.cache
def page_style() -> str:
    """Returns the CSS of all pages."""
    source, _, _ = cast("PackageLoader", _templates().loader).get_source(_templates(), "page.css")
    return source


@functools.cache
def style_digest() -> str:
    """Returns the digest of the style, as a content security policy names it."""
    return f"sha256-{base64.b64encode(hashlib.sha256(page_style().encode()).digest()).decode()}"


def moment(at_s: float) -> str:
    """Returns a time as a person reads it, by the clock of Greenwich."""
    return _utc(at_s).strftime("%Y-%m-%d %H:%M:%S") if _is_time(at_s) else "an unknown time"


def age(at_s: float, now_s: float) -> str:
    """Returns how long ago a time was, in its greatest unit; of one that is to come, how far away it is."""
    seconds = int(abs(now_s - at_s)) if _is_time(at_s) else 0
    size, unit = next(((size, unit) for size, unit in _AGES if seconds >= size), _AGES[-1])
    count = seconds // size
    text = f"{count:,} {unit}{'' if count == 1 else 's'}"
    if not _is_time(at_s) or not count:
        return "now" if _is_time(at_s) else ""
    return f"{text} ago" if at_s <= now_s else f"in {text}"


def _is_time(at_s: float) -> bool:
    return 0 <= at_s < 1e11  # what a clock shows; NaN is neither


def _utc(at_s: float) -> datetime:
    return datetime.fromtimestamp(at_s, tz=UTC)


def _iso(at_s: float) -> str:
    return _utc(at_s).isoformat(timespec="seconds") if _is_time(at_s) else ""


def _sort(block: Block) -> str:
    match block:
        case Table():
            return "table"
        case Facts():
            return "facts"
        case Gallery():
            return "gallery"
        case Text():
            return "text"


def _filled(table: Table) -> list[int]:
    """Returns the positions of the columns that have something in a row, and of the first."""
    return [at for at in range(len(table.columns)) if not at or any(not row[at].is_blank for row in table.rows)]


def _render(template: str, **values: object) -> bytes:
    # The style is marked as markup, and Markup would be spoilt by a character less: its digest is in the policy.
    return _templates().get_template(template).render(style=Markup(page_style()), **values).encode()  # noqa: S704 - own file


@functools.cache
def _templates() -> Environment:
    found = Environment(
        loader=PackageLoader("tasks.gateway.page"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_fit,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    tools = {"sort": _sort, "filled": _filled, "moment": moment, "iso": _iso, "age": age, "tone": tone_of}
    cast("dict[str, Any]", found.globals).update(tools)
    return found


def _fit(value: object) -> object:
    """Returns a text with a sign in the place of what turns the text around it, or what HTML cannot hold."""
    return xml_text(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def own_headers(*, is_secure: bool) -> Mapping[str, str]:
    """Returns the headers of a page that Simyard makes: its own style, its own pictures, and nothing else.

    Args:
        is_secure: Whether the browser came by TLS, and shall always do so.
    """
    # With "no-referrer" a browser would send the form without its origin, which the form's answer looks at.
    policy = f"default-src 'none'; style-src '{style_digest()}'; img-src 'self' data:; form-action 'self'; {_NOWHERE}"
    return {
        **_ALWAYS,
        "Content-Security-Policy": policy,
        "Referrer-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
        "Cache-Control": "no-store",
        **({"Strict-Transport-Security": "max-age=31536000"} if is_secure else {}),
    }


def stored_content_headers(*, keep_s: int = 0, file_name: str = "") -> Mapping[str, str]:
    """Returns the headers of what lies in a store: a browser gives it no script, no session and no address.

    ``sandbox`` makes its origin one that nothing else has. There is no Cross-Origin-Opener-Policy: browsers show no
    page that has both.

    Args:
        keep_s: How long the browser may keep it.
        file_name: What it is saved as; empty for what is shown.
    """
    return {
        **_ALWAYS,
        "Content-Security-Policy": f"{_STORED_CONTENT}; form-action 'none'; {_NOWHERE}",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": f"private, max-age={keep_s}" if keep_s else "no-store",
        **({"Content-Disposition": f'attachment; filename="{file_name}"'} if file_name else {}),
    }
