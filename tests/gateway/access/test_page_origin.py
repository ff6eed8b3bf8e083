"""Pages of other sites, and names of others for this address."""

import pytest

from specs.errors import AccessRefused
from tasks.gateway.access.guard import is_loopback, loopback_hosts, refuse_other_pages
from tasks.gateway.rest_json import HttpRequest

HERE = "127.0.0.1:8600"


def request(*headers: tuple[str, str], method: str = "POST", body: bytes = b"{}") -> HttpRequest:
    named = headers if any(name == "host" for name, _ in headers) else (("host", HERE), *headers)
    return HttpRequest(method, "/createFleet", "", named, body)


@pytest.mark.parametrize("host", ["127.0.0.1:8600", "localhost:8600", "[::1]:8600", "LOCALHOST:8600"])
def test_programs_of_this_machine_pass(host: str) -> None:
    refuse_other_pages(request(("host", host)), operation=True, hosts=loopback_hosts(8600))


@pytest.mark.parametrize(
    "host", ["", "evil.example", "evil.example:8600", "127.0.0.1", "127.0.0.1:80", "localhost.evil:8600", "127.1:8600"]
)
def test_another_name_for_this_address_is_refused(host: str) -> None:
    with pytest.raises(AccessRefused, match="asked for by"):
        refuse_other_pages(request(("host", host)), operation=True, hosts=loopback_hosts(8600))


@pytest.mark.parametrize(
    "headers",
    [
        [("origin", "http://evil.example")],
        [("origin", "null")],
        [("origin", "")],
        [("origin", "http://127.0.0.1:9000")],
        [("origin", f"http://{HERE}"), ("origin", "http://evil.example")],
        [("sec-fetch-site", "cross-site")],
        [("sec-fetch-site", "same-site")],
        [("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate")],
        [("sec-fetch-site", "none"), ("sec-fetch-site", "cross-site")],
        [("host", HERE), ("host", "evil.example")],
    ],
)
@pytest.mark.parametrize("method", ["GET", "POST", "DELETE"])
def test_a_page_of_another_site_is_refused(headers: list[tuple[str, str]], method: str) -> None:
    with pytest.raises(AccessRefused):
        refuse_other_pages(request(*headers, method=method), operation=True)


@pytest.mark.parametrize(
    "headers", [[], [("origin", f"http://{HERE}"), ("sec-fetch-site", "same-origin")], [("sec-fetch-site", "none")]]
)
def test_an_own_page_passes(headers: list[tuple[str, str]]) -> None:
    refuse_other_pages(request(*headers), operation=True, hosts=loopback_hosts(8600))


@pytest.mark.parametrize(("method", "passes"), [("GET", True), ("POST", False)])
def test_a_link_to_a_page_may_be_followed(method: str, passes: bool) -> None:  # noqa: FBT001 - a case
    asked = request(("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate"), method=method)
    if passes:
        refuse_other_pages(asked, operation=False)
    else:
        with pytest.raises(AccessRefused):
            refuse_other_pages(asked, operation=False)


@pytest.mark.parametrize(
    ("host", "own"),
    [
        ("127.0.0.1", True),
        ("127.8.8.8", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),  # noqa: S104
        ("::", False),
        ("10.0.0.1", False),
        ("localhost.example", False),
        ("", False),
    ],
)
def test_only_this_machine_reaches_loopback(host: str, own: bool) -> None:  # noqa: FBT001 - a case
    assert is_loopback(host) is own
