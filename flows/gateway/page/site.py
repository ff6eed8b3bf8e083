"""Answers a browser: signs in and out, finds the page of an address, and renders it.

A browser signs in by an access key: a form, a session in a cookie, and a limit for who guesses.
"""

import logging
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol
from urllib.parse import parse_qs, quote, unquote

from pydantic import ValidationError
from starlette.routing import compile_path

from flows.gateway.page.files import batch_file, contact_sheet, floor_plan, trend_file
from flows.gateway.page.fleet_pages import (
    application_page,
    applications_page,
    deployment_page,
    deployments_page,
    deployments_table,
    fleet_page,
    fleets_page,
    fleets_table,
    robot_page,
    robots_page,
)
from flows.gateway.page.request_context import SECTIONS, Listings, RequestContext, nothing_there
from flows.gateway.page.run_pages import (
    batch_page,
    batches_page,
    batches_table,
    job_page,
    run_page,
    runs_page,
    runs_table,
)
from flows.gateway.page.world_pages import (
    export_page,
    exports_page,
    generation_page,
    generations_page,
    template_page,
    templates_page,
    world_page,
    worlds_gallery,
    worlds_page,
)
from specs.errors import DocumentError, StoreError
from tasks.gateway.page.content import GOING, Frame, Page
from tasks.gateway.page.render import notice_html, own_headers, page_html, sign_in_html
from tasks.gateway.page.session import (
    LIFE_S,
    EndedSessions,
    LoginRateLimit,
    Session,
    cookie_header,
    cookie_name,
    cookie_value,
    matches,
    new_session,
    open_session,
    seal_session,
)
from tasks.gateway.rest_json import HttpAnswer, HttpRequest
from tasks.storage.base.store import Store
from tasks.storage.store_url import store_id

_ROWS, _PICTURES = 5, 4
_HTML = "text/html; charset=utf-8"
_FORM = "application/x-www-form-urlencoded"
_MOST_FORM_BYTES = 4096
_PORT = re.compile(r":([0-9]{1,5})$")
# A path of this very site: two slashes, or one and a backslash, would begin another's name.
_BACK = re.compile(r"/(?![/\\])[A-Za-z0-9._~%/?=&+-]{0,1000}")
_LOG = logging.getLogger(__name__)
_FORMS = frozenset({"sign-in", "sign-out"})
_MOST_STEP_DIGITS = 6
_MOST_PATH, _MOST_KEY = 1024, 128


def home_page(context: RequestContext) -> Page:
    """Returns the newest of everything, and where all of it is."""
    tables = (
        batches_table(context, _ROWS, "/batches"),
        runs_table(context, _ROWS, "/runs"),
        fleets_table(context, _ROWS, "/fleets"),
        deployments_table(context, _ROWS, "/deployments"),
    )
    batches, runs, fleets, deployments = tables
    going = any(cell.is_state and cell.text in GOING for table in tables for row in table.rows for cell in row)
    blocks = (batches, runs, worlds_gallery(context, _PICTURES, "/worlds"), fleets, deployments)
    return Page("What is new", f"Store {context.store_id}", blocks=blocks, is_going=going)


class Readers(Protocol):
    """Who may sign in, and what each may see; asked from several threads at once."""

    def secret_of(self, key_id: str) -> str | None:
        """Returns the secret of a key that may read; None for every other."""
        ...

    def may_read(self, key_id: str, arn: str) -> bool:
        """Returns whether a key may see the resource of an ARN."""
        ...


@dataclass(frozen=True)
class SignIns:
    """What one process remembers of who came: the sessions that were left, and wrong secrets."""

    ended: EndedSessions = field(default_factory=EndedSessions)
    rate_limit: LoginRateLimit = field(default_factory=LoginRateLimit)


def signed_in(
    sign_ins: SignIns, readers: Readers, request: HttpRequest, now_s: float, *, is_secure: bool
) -> str | None:
    """Returns the id of the key that a browser has signed in with; None if it has not."""
    session = _session(sign_ins, readers, request, now_s, is_secure=is_secure)
    return session.key_id if session else None


def sign_in(sign_ins: SignIns, readers: Readers, request: HttpRequest, now_s: float, *, is_secure: bool) -> HttpAnswer:
    """Answers the form: with a session, or with the form once more."""
    headers = own_headers(is_secure=is_secure)
    if refusal := _not_from_here(request, headers):
        return refusal
    form = _form(request)
    key_id, back = form.get("key", "").strip(), safe_back(form.get("back", "/"))
    secret, guesser = readers.secret_of(key_id), f"{request.client} {key_id[:_MOST_KEY]}"
    if not matches(secret, form.get("secret", "").strip()) or secret is None:
        # Only who is wrong waits: behind a proxy all come from one address, and one of them must not keep out others.
        wait_s = sign_ins.rate_limit.begin(guesser, now_s)
        if wait_s > 0:
            reason = f"Too many wrong secrets of this key came from your address. Wait {wait_s:.0f} seconds."
            return _page_answer(sign_in_html(back, reason), {**headers, "Retry-After": f"{wait_s:.0f}"}, 429)
        return _page_answer(
            sign_in_html(back, "That is no key with its secret, or the key may not read."), headers, 403
        )
    sign_ins.rate_limit.forgive(guesser)
    cookie = _cookie(request, seal_session(new_session(key_id, now_s), secret), LIFE_S, is_secure=is_secure)
    return HttpAnswer(303, b"", _HTML, headers={**headers, "Location": back, "Set-Cookie": cookie})


def sign_out(sign_ins: SignIns, readers: Readers, request: HttpRequest, now_s: float, *, is_secure: bool) -> HttpAnswer:
    """Ends the session of a browser."""
    headers = own_headers(is_secure=is_secure)
    if refusal := _not_from_here(request, headers):
        return refusal
    session = _session(sign_ins, readers, request, now_s, is_secure=is_secure)
    if session:
        sign_ins.ended.end(session)
    cookie = _cookie(request, "", 0, is_secure=is_secure)
    return HttpAnswer(303, b"", _HTML, headers={**headers, "Location": "/sign-in", "Set-Cookie": cookie})


def safe_back(text: str) -> str:
    """Returns an address of this site; the first page for any other text."""
    return text if _BACK.fullmatch(text) else "/"


def _session(
    sign_ins: SignIns, readers: Readers, request: HttpRequest, now_s: float, *, is_secure: bool
) -> Session | None:
    name = cookie_name(_port(request), is_secure=is_secure)
    cookies = "; ".join(value for each, value in request.headers if each == "cookie")
    session = open_session(cookie_value(cookies, name), readers.secret_of, now_s)
    return None if session is None or session in sign_ins.ended else session


def _not_from_here(request: HttpRequest, headers: Mapping[str, str]) -> HttpAnswer | None:
    """Returns a refusal of a form of another site, which would sign its reader in, or out."""
    sent = dict(request.headers)
    host, origin = sent.get("host", ""), sent.get("origin", "")
    if host and origin.lower() in {f"http://{host}".lower(), f"https://{host}".lower()}:
        return None
    return _page_answer(notice_html("Refused", "This form comes from another page.", "/sign-in"), headers, 403)


def _form(request: HttpRequest) -> Mapping[str, str]:
    kind = dict(request.headers).get("content-type", "").partition(";")[0].strip().lower()
    if kind != _FORM or len(request.body) > _MOST_FORM_BYTES:
        return {}
    try:
        fields = parse_qs(request.body.decode(), max_num_fields=8)
    except ValueError:
        return {}
    return {name: values[0] for name, values in fields.items()}


def _cookie(request: HttpRequest, value: str, life_s: int, *, is_secure: bool) -> str:
    return cookie_header(cookie_name(_port(request), is_secure=is_secure), value, life_s, is_secure=is_secure)


def _port(request: HttpRequest) -> str:
    found = _PORT.search(dict(request.headers).get("host", ""))
    return found[1] if found else "80"


_PAGES: Mapping[str, Callable[..., Page | HttpAnswer]] = {
    "/": home_page,
    "/runs": runs_page,
    "/runs/{name}": run_page,
    "/batches": batches_page,
    "/batches/{name}": batch_page,
    "/batches/trends/{document}.html": trend_file,
    "/batches/{batch}/{file}": batch_file,
    "/batches/{batch}/jobs/{index}": job_page,
    "/worlds": worlds_page,
    "/worlds/{generation}/{name}.svg": floor_plan,
    "/worlds/{generation}/{name}": world_page,
    "/generations": generations_page,
    "/generations/{name}": generation_page,
    "/generations/{name}/contact-sheet.svg": contact_sheet,
    "/exports": exports_page,
    "/exports/{name}": export_page,
    "/templates": templates_page,
    "/templates/{name}": template_page,
    "/applications": applications_page,
    "/applications/{section}/{name}": application_page,
    "/fleets": fleets_page,
    "/fleets/{name}": fleet_page,
    "/robots": robots_page,
    "/robots/{name}": robot_page,
    "/deployments": deployments_page,
    "/deployments/{name}": deployment_page,
}
# Matched before a part is decoded, so that an encoded slash belongs to a name, which then is none.
_ROUTES = tuple((compile_path(path)[0], page) for path, page in _PAGES.items())
_SECTIONS = frozenset(path.split("/")[1] for path in _PAGES)


# Everything is GET but the two forms. Whoever may not see something is told the same as if it were not there.
@dataclass(frozen=True)
class Site:
    """What answers browsers.

    Attributes:
        store: What is shown.
        readers: Who may sign in, and see what; None where everybody who gets here sees all.
        is_secure: Whether browsers come by TLS.
        prefect_url: Says where the pages of the Prefect server are; empty if none is known.
        sign_ins: Who came.
        listings: What lists showed last.
    """

    store: Store
    readers: Readers | None
    is_secure: bool = False
    prefect_url: Callable[[], str] = str
    sign_ins: SignIns = field(default_factory=SignIns)
    listings: Listings = field(default_factory=Listings)


def answer_page(site: Site, request: HttpRequest) -> HttpAnswer | None:
    """Returns what a browser is answered; None for an address that is no page's."""
    root, _, rest = request.raw_path[:_MOST_PATH].partition("/")
    section, _, name = rest.partition("/")
    if root or section not in _SECTIONS | _FORMS or (section in _FORMS and name):
        return None
    now_s, headers = time.time(), own_headers(is_secure=site.is_secure)
    if request.method == "POST":
        return _posted(site, request, section, now_s)
    if request.method not in {"GET", "HEAD"} or section == "sign-out":
        return None
    key = reader_of(site, request) or None if site.readers else ""
    if section == "sign-in":
        back = _back(request.query) if site.readers and key is None else "/"
        return _page_answer(sign_in_html(back, ""), headers) if site.readers and key is None else _see("/", headers)
    if key is None:
        return _without_session(request, headers)
    return _shown(site, request, key, now_s)


def reader_of(site: Site, request: HttpRequest) -> str:
    """Returns the id of the key that a browser has signed in with; empty if it has not, or need not."""
    if site.readers is None:
        return ""
    return signed_in(site.sign_ins, site.readers, request, time.time(), is_secure=site.is_secure) or ""


def _posted(site: Site, request: HttpRequest, section: str, now_s: float) -> HttpAnswer | None:
    if site.readers is None or section not in _FORMS:
        return None
    answer = sign_in if section == "sign-in" else sign_out
    return answer(site.sign_ins, site.readers, request, now_s, is_secure=site.is_secure)


def _shown(site: Site, request: HttpRequest, key: str, now_s: float) -> HttpAnswer:
    query = parse_qs(request.query[:200], max_num_fields=8)
    headers = own_headers(is_secure=site.is_secure)
    identifier = store_id(site.store)
    readers = site.readers
    may_read: Callable[[str], bool] = (lambda arn: readers.may_read(key, arn)) if readers else (lambda _: True)
    context = RequestContext(
        site.store, identifier, may_read, now_s, _step(query), site.prefect_url, key, site.listings
    )
    try:
        found = _found(context, request.raw_path)
    except DocumentError:
        sentence = "There is nothing at this address, or your key may not see it."
        return _page_answer(notice_html("Nothing here", sentence), headers, 404)
    except StoreError as exc:
        _LOG.warning("%a: %a", request.raw_path[:200], str(exc)[:1000])
        return _page_answer(notice_html("The store does not answer", "Try again in a minute."), headers, 503)
    except (ValidationError, LookupError, TypeError, ValueError):
        _LOG.exception("%a cannot be shown", request.raw_path[:200])
        sentence = "What the store holds here was not written by this version of Simyard."
        return _page_answer(notice_html("This cannot be shown", sentence), headers, 500)
    if isinstance(found, HttpAnswer):
        return replace(found, headers={**found.headers, **_transport(headers)})
    here = quote(unquote(request.raw_path))
    shown = f"{here}?step={context.step}" if context.step > 1 else here
    frame = Frame(shown, "still" in query, key, now_s, SECTIONS)
    return _page_answer(page_html(found, frame), headers)


def _found(context: RequestContext, raw_path: str) -> Page | HttpAnswer:
    for pattern, page in _ROUTES if len(raw_path) <= _MOST_PATH else ():
        if match := pattern.match(raw_path):
            names = [unquote(each) for each in match.groups()]
            if any("/" in each or "\0" in each for each in names):
                break
            return page(context, *names)
    raise nothing_there()


def _without_session(request: HttpRequest, headers: Mapping[str, str]) -> HttpAnswer:
    """Returns what somebody without a session gets: the form, or on their way from another site one more step.

    A browser does not send the cookie when a page of another site, or a report, leads here; it does when this does.
    """
    sent = dict(request.headers)
    back = f"{request.raw_path}?{request.query}" if request.query else request.raw_path
    if sent.get("sec-fetch-dest", "document") != "document":
        return HttpAnswer(401, b"sign in first", "text/plain", headers=headers)
    if sent.get("sec-fetch-site") == "cross-site":
        return _page_answer(
            notice_html("Simyard", "You come from another page.", safe_back(back), by_itself=True), headers
        )
    return _see(f"/sign-in?back={quote(safe_back(back), safe='')}", headers)


def _step(query: Mapping[str, list[str]]) -> int:
    text = query.get("step", ["1"])[0]
    is_number = text.isascii() and text.isdecimal() and len(text) <= _MOST_STEP_DIGITS
    return max(1, int(text)) if is_number else 1


def _back(query: str) -> str:
    return safe_back(parse_qs(query[:1000], max_num_fields=8).get("back", ["/"])[0])


def _transport(headers: Mapping[str, str]) -> Mapping[str, str]:
    name = "Strict-Transport-Security"
    return {name: headers[name]} if name in headers else {}


def _page_answer(body: bytes, headers: Mapping[str, str], status: int = 200) -> HttpAnswer:
    return HttpAnswer(status, body, _HTML, headers=headers)


def _see(address: str, headers: Mapping[str, str]) -> HttpAnswer:
    return HttpAnswer(303, b"", _HTML, headers={**headers, "Location": address})
