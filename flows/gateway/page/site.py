"""Answers a browser: signs in and out, finds the page of an address, and renders it.

Everything is GET but the two forms. Whoever may not see something is told the same as if it were not there.
"""

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from urllib.parse import parse_qs, quote, unquote

from pydantic import ValidationError

from flows.gateway.page.application_pages import KINDS, application_page, applications_page
from flows.gateway.page.batch_pages import batch_page, batches_page, job_page
from flows.gateway.page.files import batch_file, contact_sheet, floor_plan, trend_file
from flows.gateway.page.fleet_pages import (
    deployment_page,
    deployments_page,
    fleet_page,
    fleets_page,
    robot_page,
    robots_page,
)
from flows.gateway.page.home import home_page
from flows.gateway.page.run_pages import run_page, runs_page
from flows.gateway.page.sign_in import Door, Readers, safe_back, sign_in, sign_out, signed_in
from flows.gateway.page.visit import SECTIONS, Visit, nothing_there
from flows.gateway.page.world_pages import (
    export_page,
    exports_page,
    generation_page,
    generations_page,
    template_page,
    templates_page,
    world_page,
    worlds_page,
)
from specs.errors import DocumentError, StoreError
from tasks.gateway.messages import HttpAnswer, HttpRequest
from tasks.gateway.page.content import Frame, Page
from tasks.gateway.page.headers import own_headers
from tasks.gateway.page.render import notice_html, page_html, sign_in_html
from tasks.storage.base.store import Store
from tasks.storage.store_url import store_id

_LOG = logging.getLogger(__name__)
_HTML = "text/html; charset=utf-8"
_LISTS: Mapping[str, Callable[[Visit], Page]] = {
    "": home_page,
    "runs": runs_page,
    "batches": batches_page,
    "worlds": worlds_page,
    "generations": generations_page,
    "exports": exports_page,
    "templates": templates_page,
    "applications": applications_page,
    "fleets": fleets_page,
    "robots": robots_page,
    "deployments": deployments_page,
}
_OF_ONE: Mapping[str, Callable[[Visit, str], Page]] = {
    "runs": run_page,
    "batches": batch_page,
    "generations": generation_page,
    "exports": export_page,
    "templates": template_page,
    "fleets": fleet_page,
    "robots": robot_page,
    "deployments": deployment_page,
}
_FORMS = frozenset({"sign-in", "sign-out"})
_MOST_STEP_DIGITS = 6
_MOST_PATH = 1024


@dataclass(frozen=True)
class Site:
    """What answers browsers.

    Attributes:
        store: What is shown.
        readers: Who may sign in, and see what; None where everybody who gets here sees all.
        is_secure: Whether browsers come by TLS.
        prefect_url: Says where the pages of the Prefect server are; empty if none is known.
    """

    store: Store
    readers: Readers | None
    is_secure: bool = False
    prefect_url: Callable[[], str] = str
    door: Door = field(default_factory=Door)


def answer_page(site: Site, request: HttpRequest) -> HttpAnswer | None:
    """Returns what a browser is answered; None for an address that is no page's."""
    parts = _parts(request.raw_path)
    if parts is None or parts[0] not in {*_LISTS, *_FORMS}:
        return None
    now_s, headers = time.time(), own_headers(is_secure=site.is_secure)
    if request.method == "POST":
        return _posted(site, request, parts, now_s)
    if request.method not in {"GET", "HEAD"} or parts[0] == "sign-out":
        return None
    key = signed_in(site.door, site.readers, request, now_s, is_secure=site.is_secure) if site.readers else ""
    if parts[0] == "sign-in":
        back = _back(request.query) if site.readers and key is None else "/"
        return _html(sign_in_html(back, ""), headers) if site.readers and key is None else _see("/", headers)
    if key is None:
        return _stranger(request, headers)
    return _shown(site, request, parts, key, now_s)


def _posted(site: Site, request: HttpRequest, parts: list[str], now_s: float) -> HttpAnswer | None:
    if site.readers is None or len(parts) != 1 or parts[0] not in _FORMS:
        return None
    answer = sign_in if parts[0] == "sign-in" else sign_out
    return answer(site.door, site.readers, request, now_s, is_secure=site.is_secure)


def _shown(site: Site, request: HttpRequest, parts: list[str], key: str, now_s: float) -> HttpAnswer:
    query = parse_qs(request.query[:200], max_num_fields=8)
    headers = own_headers(is_secure=site.is_secure)
    identifier = store_id(site.store)
    readers = site.readers
    may_read: Callable[[str], bool] = (lambda arn: readers.may_read(key, arn)) if readers else (lambda _: True)
    visit = Visit(site.store, identifier, may_read, now_s, _step(query), site.prefect_url)
    try:
        found = _found(visit, parts)
    except DocumentError:
        sentence = "There is nothing at this address, or your key may not see it."
        return _html(notice_html("Nothing here", sentence), headers, 404)
    except StoreError as exc:
        _LOG.warning("%a: %a", request.raw_path[:200], str(exc)[:1000])
        return _html(notice_html("The store does not answer", "Try again in a minute."), headers, 503)
    except (ValidationError, LookupError, TypeError, ValueError):
        _LOG.exception("%a cannot be shown", request.raw_path[:200])
        sentence = "What the store holds here was not written by this version of Simyard."
        return _html(notice_html("This cannot be shown", sentence), headers, 500)
    if isinstance(found, HttpAnswer):
        return replace(found, headers={**found.headers, **_transport(headers)})
    here = "/" + "/".join(quote(part) for part in parts)
    shown = f"{here}?step={visit.step}" if visit.step > 1 else here
    frame = Frame(shown, "still" in query, key, now_s, SECTIONS)
    return _html(page_html(found, frame), headers)


def _found(visit: Visit, parts: list[str]) -> Page | HttpAnswer:
    return _file(visit, parts) or _page(visit, parts)


def _file(visit: Visit, parts: list[str]) -> HttpAnswer | None:
    match parts:
        case ["batches", "trends", name] if name.endswith(".html"):
            return trend_file(visit, name.removesuffix(".html"))
        case ["batches", batch, name]:
            return batch_file(visit, batch, name)
        case ["generations", name, "contact-sheet.svg"]:
            return contact_sheet(visit, name)
        case ["worlds", generation, name] if name.endswith(".svg"):
            return floor_plan(visit, generation, name.removesuffix(".svg"))
        case _:
            return None


def _page(visit: Visit, parts: list[str]) -> Page:
    match parts:
        case [section]:
            return _LISTS[section](visit)
        case [section, name] if section in _OF_ONE:
            return _OF_ONE[section](visit, name)
        case ["batches", batch, "jobs", index]:
            return job_page(visit, batch, index)
        case ["worlds", generation, name]:
            return world_page(visit, generation, name)
        case ["applications", kind, name] if kind in KINDS:
            return application_page(visit, KINDS[kind], name)
        case _:
            raise nothing_there()


def _stranger(request: HttpRequest, headers: Mapping[str, str]) -> HttpAnswer:
    """Returns what somebody without a session gets: the form, or on their way from another site one more step.

    A browser does not send the cookie when a page of another site, or a report, leads here; it does when this does.
    """
    sent = dict(request.headers)
    back = f"{request.raw_path}?{request.query}" if request.query else request.raw_path
    if sent.get("sec-fetch-dest", "document") != "document":
        return HttpAnswer(401, b"sign in first", "text/plain", headers=headers)
    if sent.get("sec-fetch-site") == "cross-site":
        return _html(notice_html("Simyard", "You come from another page.", safe_back(back), by_itself=True), headers)
    return _see(f"/sign-in?back={quote(safe_back(back), safe='')}", headers)


def _parts(raw_path: str) -> list[str] | None:
    """Returns the parts of a path, each decoded; None for what no page has."""
    if not raw_path.startswith("/") or len(raw_path) > _MOST_PATH:
        return None
    parts = [unquote(part) for part in raw_path[1:].split("/")]
    return None if any("/" in part or "\0" in part for part in parts) else parts


def _step(query: Mapping[str, list[str]]) -> int:
    text = query.get("step", ["1"])[0]
    is_number = text.isascii() and text.isdecimal() and len(text) <= _MOST_STEP_DIGITS
    return max(1, int(text)) if is_number else 1


def _back(query: str) -> str:
    return safe_back(parse_qs(query[:1000], max_num_fields=8).get("back", ["/"])[0])


def _transport(headers: Mapping[str, str]) -> Mapping[str, str]:
    name = "Strict-Transport-Security"
    return {name: headers[name]} if name in headers else {}


def _html(body: bytes, headers: Mapping[str, str], status: int = 200) -> HttpAnswer:
    return HttpAnswer(status, body, _HTML, headers=headers)


def _see(address: str, headers: Mapping[str, str]) -> HttpAnswer:
    return HttpAnswer(303, b"", _HTML, headers={**headers, "Location": address})
