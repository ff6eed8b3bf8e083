"""Requests signed by botocore, as its clients send them."""

import time

from botocore.auth import SigV4Auth
from botocore.awsrequest import AWSRequest
from botocore.credentials import Credentials

from tasks.gateway.rest_json import HttpRequest

KEY_ID = "SIMYARDTEST000000001"
SECRET = "s3cret/of+the-tests"  # noqa: S105 - of nobody
HOST = "robots.example:8600"


def signed_request(
    method: str = "POST",
    target: str = "/createFleet",
    body: bytes = b"{}",
    *,
    headers: dict[str, str] | None = None,
    secret: str = SECRET,
    key_id: str = KEY_ID,
    region: str = "eu-west-1",
    service: str = "robomaker",
    host: str = HOST,
) -> HttpRequest:
    """Returns a request as botocore signs it now; the target is path and query, encoded."""
    asked = AWSRequest(method=method, url=f"http://{host}{target}", data=body, headers=headers or {})
    SigV4Auth(Credentials(key_id, secret), service, region).add_auth(asked)
    prepared = asked.prepare()
    sent = [("host", host), *((str(name).lower(), _text(value)) for name, value in prepared.headers.items())]
    path, _, query = target.partition("?")
    return HttpRequest(method, path, query, tuple(sent), body, "127.0.0.1")


def changed(request: HttpRequest, **headers: str | None) -> HttpRequest:
    """Returns the request with headers set, or left out; an underscore stands for a hyphen."""
    new = {name.replace("_", "-"): value for name, value in headers.items()}
    kept = [(name, value) for name, value in request.headers if name not in new]
    added = [(name, value) for name, value in new.items() if value is not None]
    return HttpRequest(request.method, request.raw_path, request.query, (*kept, *added), request.body, request.client)


def header(request: HttpRequest, name: str) -> str:
    """Returns the value of a header."""
    return dict(request.headers)[name]


def now_s() -> float:
    """Returns the time that botocore signs with."""
    return time.time()


def _text(value: str | bytes) -> str:
    return value.decode("latin-1") if isinstance(value, bytes) else value
