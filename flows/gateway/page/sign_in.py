"""Signing in by an access key, and out: a form, a session in a cookie, and a brake for who guesses."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol
from urllib.parse import parse_qs

from tasks.gateway.messages import HttpAnswer, HttpRequest
from tasks.gateway.page.brake import SignInBrake
from tasks.gateway.page.headers import own_headers
from tasks.gateway.page.render import notice_html, sign_in_html
from tasks.gateway.page.session import (
    LIFE_S,
    EndedSessions,
    Session,
    cookie_header,
    cookie_name,
    cookie_value,
    matches,
    new_session,
    open_session,
    seal_session,
)

_HTML = "text/html; charset=utf-8"
_FORM = "application/x-www-form-urlencoded"
_MOST_FORM_BYTES = 4096
_PORT = re.compile(r":([0-9]{1,5})$")
# A path of this very site: two slashes, or one and a backslash, would begin another's name.
_BACK = re.compile(r"/(?![/\\])[A-Za-z0-9._~%/?=&+-]{0,1000}")


class Readers(Protocol):
    """Who may sign in, and what each may see; asked from several threads at once."""

    def secret_of(self, key_id: str) -> str | None:
        """Returns the secret of a key that may read; None for every other."""
        ...

    def may_read(self, key_id: str, arn: str) -> bool:
        """Returns whether a key may see the resource of an ARN."""
        ...


@dataclass(frozen=True)
class Door:
    """What one process remembers of who came: the sessions that were left, and wrong secrets."""

    ended: EndedSessions = field(default_factory=EndedSessions)
    brake: SignInBrake = field(default_factory=SignInBrake)


def signed_in(door: Door, readers: Readers, request: HttpRequest, now_s: float, *, is_secure: bool) -> str | None:
    """Returns the id of the key that a browser has signed in with; None if it has not."""
    session = _session(door, readers, request, now_s, is_secure=is_secure)
    return session.key_id if session else None


def sign_in(door: Door, readers: Readers, request: HttpRequest, now_s: float, *, is_secure: bool) -> HttpAnswer:
    """Answers the form: with a session, or with the form once more."""
    headers = own_headers(is_secure=is_secure)
    if refusal := _not_from_here(request, headers):
        return refusal
    form = _form(request)
    key_id, back = form.get("key", "").strip(), safe_back(form.get("back", "/"))
    wait_s = door.brake.begin(request.client, now_s)
    if wait_s > 0:
        reason = f"Too many wrong keys came from your address. Try again in {wait_s:.0f} seconds."
        return _html(429, sign_in_html(back, reason), {**headers, "Retry-After": f"{wait_s:.0f}"})
    secret = readers.secret_of(key_id)
    if not matches(secret, form.get("secret", "").strip()) or secret is None:
        return _html(403, sign_in_html(back, "That is no key with its secret, or the key may not read."), headers)
    door.brake.forgive(request.client)
    cookie = _cookie(request, seal_session(new_session(key_id, now_s), secret), LIFE_S, is_secure=is_secure)
    return HttpAnswer(303, b"", _HTML, headers={**headers, "Location": back, "Set-Cookie": cookie})


def sign_out(door: Door, readers: Readers, request: HttpRequest, now_s: float, *, is_secure: bool) -> HttpAnswer:
    """Ends the session of a browser."""
    headers = own_headers(is_secure=is_secure)
    if refusal := _not_from_here(request, headers):
        return refusal
    session = _session(door, readers, request, now_s, is_secure=is_secure)
    if session:
        door.ended.end(session)
    cookie = _cookie(request, "", 0, is_secure=is_secure)
    return HttpAnswer(303, b"", _HTML, headers={**headers, "Location": "/sign-in", "Set-Cookie": cookie})


def safe_back(text: str) -> str:
    """Returns an address of this site; the first page for any other text."""
    return text if _BACK.fullmatch(text) else "/"


def _session(door: Door, readers: Readers, request: HttpRequest, now_s: float, *, is_secure: bool) -> Session | None:
    name = cookie_name(_port(request), is_secure=is_secure)
    cookies = "; ".join(value for each, value in request.headers if each == "cookie")
    session = open_session(cookie_value(cookies, name), readers.secret_of, now_s)
    return None if session is None or session in door.ended else session


def _not_from_here(request: HttpRequest, headers: Mapping[str, str]) -> HttpAnswer | None:
    """Returns a refusal of a form of another site, which would sign its reader in, or out."""
    sent = dict(request.headers)
    host, origin = sent.get("host", ""), sent.get("origin", "")
    if host and origin.lower() in {f"http://{host}".lower(), f"https://{host}".lower()}:
        return None
    return _html(403, notice_html("Refused", "This form comes from another page.", "/sign-in"), headers)


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


def _html(status: int, body: bytes, headers: Mapping[str, str]) -> HttpAnswer:
    return HttpAnswer(status, body, _HTML, headers=headers)
