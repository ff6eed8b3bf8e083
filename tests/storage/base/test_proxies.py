"""What lies past a proxy, and which proxies no client here can use."""

import urllib.request

import pytest

from tasks.storage.base.proxies import (
    exception_lines,
    is_local,
    proxy_exceptions,
    useless_proxies,
    without_useless_proxies,
)


def test_programs_are_told_to_reach_this_machine_past_the_proxy(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
    for name, value in proxy_exceptions({"NO_PROXY": "example.org,localhost"}).items():
        monkeypatch.setenv(name, value)
    assert urllib.request.proxy_bypass("127.0.0.1:4200")
    assert urllib.request.proxy_bypass("localhost:4200")
    assert urllib.request.proxy_bypass("example.org")
    assert not urllib.request.proxy_bypass("elsewhere.org")


def test_exceptions_from_the_proxy_are_kept_once():
    assert proxy_exceptions({"no_proxy": "a.org,127.0.0.1"})["no_proxy"] == "a.org,127.0.0.1,localhost"


@pytest.mark.parametrize(
    ("api_url", "local"),
    [
        ("http://127.0.0.1:4200/api", True),
        ("http://localhost:4200/api", True),
        ("http://[::1]:4200/api", True),
        ("https://api.example.org/api", False),
        ("http://10.0.0.1:4200/api", False),
    ],
)
def test_only_this_machine_is_local(api_url: str, local: bool):  # noqa: FBT001
    assert is_local(api_url) == local


@pytest.mark.parametrize(
    ("proxy", "useless"),
    [
        ("http://proxy:3128", False),
        ("proxy:3128", False),
        ("https://user:secret@proxy", False),
        ("", False),
        ("socks5://127.0.0.1:1080", True),
        ("socks4://127.0.0.1:1080", True),
        ("http://proxy:port", True),
        ("http://", True),
    ],
)
def test_a_proxy_that_no_client_can_use_is_known(monkeypatch: pytest.MonkeyPatch, proxy: str, *, useless: bool):
    monkeypatch.setattr("tasks.storage.base.proxies.find_spec", lambda _: None)  # no package for SOCKS
    environment = {"all_proxy": proxy, "PATH": "/usr/bin"}
    assert useless_proxies(environment) == (["all_proxy"] if useless else [])
    assert ("all_proxy" in without_useless_proxies(environment)) is not useless


def test_a_shell_is_told_of_exceptions_only_where_a_proxy_stands_between():
    here, proxy = "http://127.0.0.1:8600", {"HTTPS_PROXY": "http://proxy:3128"}
    assert list(exception_lines(here, proxy)) == [
        "export no_proxy=127.0.0.1,localhost",
        "export NO_PROXY=127.0.0.1,localhost",
    ]
    assert list(exception_lines(here, {})) == []
    assert list(exception_lines("https://gateway.example.org", proxy)) == []
