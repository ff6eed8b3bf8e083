"""What a browser is answered: each page, to whom, with which headers, and nothing of the machine."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from html import unescape
from pathlib import Path

import pytest

from flows.gateway.page.request_context import Listings
from flows.gateway.page.site import Site, answer_page
from specs.arn import Reference
from specs.data.world import FloorZone
from tasks.gateway.rest_json import HttpAnswer, HttpRequest
from tasks.storage.base.store import Entry
from tasks.storage.store_url import open_store
from tasks.storage.tags import change_tags, with_tags
from tasks.storage.worlds import encode_world, write_world
from tests.factories.gateway.shown_store import ATTACK, Shown, shown_store
from tests.factories.own_worlds import walled_hall

HOST = "127.0.0.1:8600"
KEY, SECRET = "SIMYARD0000000000001", "a secret of forty characters, more or less"


@dataclass(frozen=True)
class Keys:
    """One key, limited to what its ARN ends in; everything if nothing is given."""

    hidden: tuple[str, ...] = ()
    secrets: Mapping[str, str] = field(default_factory=lambda: {KEY: SECRET})

    def secret_of(self, key_id: str) -> str | None:
        return self.secrets.get(key_id)

    def may_read(self, key_id: str, arn: str) -> bool:
        return key_id in self.secrets and not any(each in arn for each in self.hidden)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store's folder, not written to by any test."""
    return tmp_path_factory.mktemp("shown")


@pytest.fixture(scope="module")
def shown(folder: Path) -> Shown:
    """What is in it, every text an attack."""
    return shown_store(open_store(folder.as_uri()), ATTACK)


@pytest.fixture(scope="module")
def open_site(folder: Path, shown: Shown) -> Site:
    """Its pages for everybody."""
    del shown
    return Site(open_store(folder.as_uri()), None, prefect_url=lambda: "http://127.0.0.1:4200")


@pytest.fixture
def site(folder: Path, shown: Shown) -> Site:
    """Its pages for who signs in, nobody having come yet."""
    del shown
    return Site(open_store(folder.as_uri()), Keys())


def request(target: str, method: str = "GET", body: bytes = b"", **headers: str) -> HttpRequest:
    path, _, query = target.partition("?")
    named = tuple((name.replace("_", "-"), value) for name, value in {"host": HOST, **headers}.items())
    return HttpRequest(method, path, query, named, body, "127.0.0.1")


def get(site: Site, target: str, **headers: str) -> HttpAnswer:
    answer = answer_page(site, request(target, "GET", b"", **headers))
    assert answer is not None
    return answer


def text(site: Site, target: str, **headers: str) -> str:
    answer = get(site, target, **headers)
    assert answer.status == 200, target
    return answer.body.decode()


def post(site: Site, target: str, body: str, **headers: str) -> HttpAnswer:
    sent = {"content_type": "application/x-www-form-urlencoded", "origin": f"http://{HOST}", **headers}
    answer = answer_page(site, request(target, "POST", body.encode(), **sent))
    assert answer is not None
    return answer


def cookie_of(answer: HttpAnswer) -> str:
    return answer.headers["Set-Cookie"].partition(";")[0]


def signed_in(site: Site) -> str:
    return cookie_of(post(site, "/sign-in", f"key={KEY}&secret={SECRET}&back=/batches"))


def test_every_page_is_there_and_its_links_lead_somewhere(open_site: Site, shown: Shown):
    pages = {page: text(open_site, page) for page in shown.pages}
    links = {unescape(each) for page in pages.values() for each in re.findall(r'(?:href|src)="(/[^"]*)"', page)}
    broken = {link: status for link in links if (status := get(open_site, link).status) not in {200, 303}}
    assert broken == {}


def test_no_text_of_the_store_becomes_markup(open_site: Site, shown: Shown):
    pages = {page: text(open_site, page) for page in shown.pages}
    assert [page for page, found in pages.items() if "<script" in found or 'onerror="' in found] == []
    assert sum("&lt;script&gt;" in found for found in pages.values()) >= 12


def test_no_page_tells_where_the_store_lies(open_site: Site, shown: Shown, folder: Path):
    assert [page for page in shown.pages if str(folder) in text(open_site, page)] == []


@pytest.mark.parametrize(
    "target",
    [
        "/batches/..%2F..%2Fstore.json",
        "/batches/../store.json",
        "/batches/x/..%2f..%2fetc%2fpasswd",
        "/batches/%2e%2e/report.html",
        "/generations/%2e%2e/contact-sheet.svg",
        "/worlds/%2e%2e/store.svg",
        "/worlds/a/..%00.svg",
        "/templates/%00",
        "/batches/trends/..%2f..%2fx.html",
        "/batches/trends/%2e%2e.html",
        "/applications/tokens/x",
        "/robots/..",
        "/fleets/" + "a" * 300,
        "/batches/none/jobs/0",
        "/runs/",
    ],
)
def test_an_address_reaches_nothing_but_what_it_names(target: str, open_site: Site):
    answer = answer_page(open_site, request(target))
    assert answer is None or answer.status == 404


@pytest.mark.parametrize("index", ["-1", "6", "00", "0x0", "99999999999999999999", "%D9%A1", "1e3", ""])
def test_a_job_that_a_batch_has_not_is_not_there(index: str, open_site: Site, shown: Shown):
    assert get(open_site, f"/batches/{shown.batch}/jobs/{index}").status == 404


def test_only_the_files_of_a_batch_are_given_out(open_site: Site, shown: Shown):
    assert get(open_site, f"/batches/{shown.batch}/report.html").status == 200
    saved = get(open_site, f"/batches/{shown.batch}/results.parquet")
    assert saved.headers["Content-Disposition"] == 'attachment; filename="results.parquet"'
    assert get(open_site, f"/batches/{shown.batch}/evidence.json").status == 404


def test_what_strangers_wrote_gets_no_script_and_no_origin(open_site: Site, shown: Shown):
    for target in (f"/batches/{shown.batch}/report.html", f"/generations/{shown.generation}/contact-sheet.svg"):
        policy = get(open_site, target).headers["Content-Security-Policy"]
        assert policy.startswith("sandbox allow-downloads; default-src 'none'")
        assert "allow-scripts" not in policy
        assert "allow-same-origin" not in policy


def test_every_answer_tells_the_browser_what_to_refuse(open_site: Site, shown: Shown):
    for target in (*shown.pages, "/batches/none", f"/batches/{shown.batch}/report.html"):
        headers = get(open_site, target).headers
        assert headers["X-Content-Type-Options"] == "nosniff", target
        assert headers["X-Frame-Options"] == "DENY", target
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"], target
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin", target
        assert headers["Referrer-Policy"] in {"same-origin", "no-referrer"}, target


def test_a_page_allows_its_own_style_and_no_script(open_site: Site):
    policy = get(open_site, "/").headers["Content-Security-Policy"]
    assert re.search(r"style-src 'sha256-[A-Za-z0-9+/]{43}='", policy)
    assert policy.startswith("default-src 'none'")
    assert "script-src" not in policy
    assert "unsafe" not in policy


def test_what_is_under_way_is_loaded_again_until_the_reader_stops_that(open_site: Site, shown: Shown):
    assert '<meta http-equiv="refresh" content="5">' in text(open_site, f"/batches/{shown.batch}")
    still = text(open_site, f"/batches/{shown.batch}?still=1")
    assert "refresh" not in still
    assert "refresh" not in text(open_site, f"/runs/{shown.run}")


def test_the_page_of_a_run_leads_to_prefects(open_site: Site, shown: Shown):
    flow_run = "http://127.0.0.1:4200/runs/flow-run/0a1b2c3d-0000-4000-8000-000000000000"
    assert f'href="{flow_run}"' in text(open_site, f"/runs/{shown.run}")


def test_who_has_not_signed_in_sees_the_form_and_nothing_else(site: Site, shown: Shown):
    for target in shown.pages:
        answer = get(site, target)
        assert (answer.status, answer.body) == (303, b""), target
        assert answer.headers["Location"].startswith("/sign-in?back=%2F"), target
    assert 'type="password"' in text(site, "/sign-in?back=/batches")


def test_a_picture_is_not_given_to_who_has_not_signed_in(site: Site, shown: Shown):
    assert get(site, f"/worlds/{shown.generation}/world-1-1.svg", sec_fetch_dest="image").status == 401


def test_who_comes_from_another_page_is_led_on_so_that_the_cookie_is_sent(site: Site):
    found = text(site, "/batches?step=2", sec_fetch_site="cross-site", sec_fetch_dest="document")
    assert '<meta http-equiv="refresh" content="0; url=/batches?step=2">' in found


def test_a_key_signs_in_and_out(site: Site):
    answer = post(site, "/sign-in", f"key={KEY}&secret={SECRET}&back=/batches")
    assert (answer.status, answer.headers["Location"]) == (303, "/batches")
    cookie = cookie_of(answer)
    assert KEY in text(site, "/batches", cookie=cookie)
    left = post(site, "/sign-out", "", cookie=cookie)
    assert "Max-Age=0" in left.headers["Set-Cookie"]
    assert get(site, "/batches", cookie=cookie).status == 303


def test_the_cookie_is_out_of_reach_of_scripts_and_other_sites(site: Site, folder: Path):
    plain = post(site, "/sign-in", f"key={KEY}&secret={SECRET}").headers["Set-Cookie"]
    assert plain.startswith("simyard-8600=")
    assert set(plain.split("; ")[1:]) == {"Path=/", "Max-Age=28800", "HttpOnly", "SameSite=strict"}
    secure = Site(open_store(folder.as_uri()), Keys(), is_secure=True)
    sent = post(secure, "/sign-in", f"key={KEY}&secret={SECRET}").headers["Set-Cookie"]
    assert sent.startswith("__Host-simyard=")
    assert set(sent.split("; ")[1:]) == {"Path=/", "Max-Age=28800", "HttpOnly", "SameSite=strict", "Secure"}
    assert SECRET not in plain


@pytest.mark.parametrize(
    "body",
    [
        f"key={KEY}&secret=wrong",
        "key=SIMYARD0000000000002&secret=",
        "key=&secret=",
        "",
        f"secret={SECRET}",
        "\ufffd",
        "&".join(f"a{n}=1" for n in range(50)),
        f"key={KEY}&secret={SECRET}&x={'a' * 5000}",
    ],
)
def test_a_wrong_key_gets_the_form_once_more(body: str, site: Site):
    answer = post(site, "/sign-in", body)
    assert answer.status == 403
    assert "Set-Cookie" not in answer.headers
    assert b'type="password"' in answer.body


def test_who_guesses_a_secret_is_told_to_wait_and_keeps_out_nobody_of_the_same_address(site: Site):
    answers = [post(site, "/sign-in", f"key={KEY}&secret={n}") for n in range(6)]
    assert [answer.status for answer in answers] == [403] * 5 + [429]
    assert int(answers[-1].headers["Retry-After"]) >= 1
    assert post(site, "/sign-in", "key=SIMYARD0000000000002&secret=wrong").status == 403
    assert post(site, "/sign-in", f"key={KEY}&secret={SECRET}").status == 303


def test_a_page_that_is_reloaded_lists_a_large_store_once(folder: Path, shown: Shown, monkeypatch: pytest.MonkeyPatch):
    del shown
    store, clock, listings = open_store(folder.as_uri()), [1000.0], list[str]()
    real = store.entries

    def slow(prefix: str) -> list[Entry]:
        listings.append(prefix)
        clock[0] += 2.0
        return real(prefix)

    monkeypatch.setattr(store, "entries", slow)
    monkeypatch.setattr("flows.gateway.page.request_context.time.monotonic", lambda: clock[0])
    now_s = time.time()  # a page says when it was made
    monkeypatch.setattr("flows.gateway.page.site.time.time", lambda: now_s)
    site = Site(store, Keys(), listings=Listings())
    cookie = signed_in(site)
    pages = {text(site, "/worlds", cookie=cookie) for _ in range(20)}
    assert (len(listings), len(pages)) == (1, 1)
    clock[0] += 21.0
    text(site, "/worlds", cookie=cookie)
    assert listings == ["worlds", "worlds"]


def test_a_list_is_made_once_for_many_who_ask_at_once():
    listings, made = Listings(), list[int]()

    def make() -> list[str]:
        made.append(1)
        time.sleep(0.2)
        return ["a"]

    with ThreadPoolExecutor(16) as pool:
        found = [*pool.map(lambda _: listings.names(("worlds", KEY), make), range(16))]
    assert (found, len(made)) == ([["a"]] * 16, 1)


class _TwoKeys(Keys):
    """One sees everything, the other nothing."""

    def may_read(self, key_id: str, arn: str) -> bool:
        return key_id == KEY and super().may_read(key_id, arn)


def test_what_one_key_may_not_see_is_in_no_list_that_another_has_asked_for(folder: Path, shown: Shown):
    site = Site(open_store(folder.as_uri()), _TwoKeys(secrets={KEY: SECRET, "other": "another secret"}))
    assert shown.batch in text(site, "/batches", cookie=signed_in(site))
    cookie = cookie_of(post(site, "/sign-in", "key=other&secret=another secret"))
    assert shown.batch not in text(site, "/batches", cookie=cookie)


@pytest.mark.parametrize("origin", ["", "null", "http://evil.example", f"http://{HOST}.evil.example", f"ftp://{HOST}"])
@pytest.mark.parametrize("form", ["/sign-in", "/sign-out"])
def test_a_form_of_another_site_is_refused(form: str, origin: str, site: Site):
    cookie = signed_in(site)
    answer = post(site, form, f"key={KEY}&secret={SECRET}", origin=origin, cookie=cookie)
    assert answer.status == 403
    assert "Set-Cookie" not in answer.headers
    assert get(site, "/", cookie=cookie).status == 200


@pytest.mark.parametrize(
    "back", ["//evil.example", "/\\evil.example", "https://evil.example", "javascript:alert(1)", "/a\r\nX: 1"]
)
def test_signing_in_leads_nowhere_else(back: str, site: Site):
    body = f"key={KEY}&secret={SECRET}&back=" + "".join(f"%{byte:02x}" for byte in back.encode())
    assert post(site, "/sign-in", body).headers["Location"] == "/"


def test_a_key_that_is_gone_has_no_session_any_more(site: Site, folder: Path):
    cookie = signed_in(site)
    later = Site(open_store(folder.as_uri()), Keys(secrets={}))
    changed = Site(open_store(folder.as_uri()), Keys(secrets={KEY: "another"}))
    same = Site(open_store(folder.as_uri()), Keys())
    assert [get(each, "/", cookie=cookie).status for each in (later, changed, same)] == [303, 303, 200]


def test_a_key_sees_what_it_may_and_is_not_told_of_the_rest(folder: Path, shown: Shown):
    limited = Site(open_store(folder.as_uri()), Keys(hidden=(":simulation-job-batch:", ":robot:", ":world:")))
    cookie = signed_in(limited)
    assert shown.batch not in text(limited, "/batches", cookie=cookie)
    assert "world-1-1" not in text(limited, "/worlds", cookie=cookie)
    assert "/robots/r1" not in text(limited, "/robots", cookie=cookie)
    assert "/robots/r1" not in text(limited, "/fleets/home", cookie=cookie)
    hidden = (f"/batches/{shown.batch}", f"/batches/{shown.batch}/report.html", "/robots/r1")
    world = f"/worlds/{shown.generation}/world-1-1"
    for target in (*hidden, f"/batches/{shown.batch}/jobs/0", world, f"{world}.svg"):
        there, absent = get(limited, target, cookie=cookie), get(limited, "/batches/simb-0", cookie=cookie)
        assert (there.status, there.body) == (404, absent.body), target


def test_a_worlds_page_has_its_zones_as_rooms(tmp_path: Path):
    store = open_store(tmp_path.as_uri())
    zone = FloorZone(name="<dock>", outline_m=((11.0, 6.0), (13.0, 6.0), (13.0, 8.0)), found=False)
    world = walled_hall().model_copy(update={"zones": (zone,)})
    write_world(store, f"{world.generation}/{world.name}", encode_world(world))
    shown = text(Site(store, None), f"/worlds/{world.generation}/{world.name}")
    assert [said in shown for said in ("&lt;dock&gt;", "2.0 m²", "with 1 room")] == [True] * 3


def test_a_damaged_record_takes_no_list_with_it(tmp_path: Path):
    store = open_store(tmp_path.as_uri())
    found = shown_store(store)
    for key in ("jobs/simulation-job-batch/simb-1.json", "jobs/pipeline-run/run-1.json", "robots/r9/record.json"):
        store.put(key, b'{"kind": []}')
    site = Site(store, None)
    assert found.batch in text(site, "/batches")
    assert found.run in text(site, "/runs")
    assert "r1" in text(site, "/robots")
    assert "r1" in text(site, "/fleets/home")
    assert get(site, "/batches/simb-1").status == 404


def test_a_long_list_comes_in_pages(tmp_path: Path):
    store = open_store(tmp_path.as_uri())
    for number in range(120):
        store.put(f"templates/t{number:03}.json", b"{}")
    site = Site(store, None)
    steps = [set(re.findall(r"/templates/(t\d+)", text(site, f"/templates?step={step}"))) for step in (1, 2, 3, 4)]
    assert [len(each) for each in steps] == [50, 50, 20, 0]
    assert len(set.union(*steps)) == 120
    assert "51 to 100 of 120" in text(site, "/templates?step=2")
    assert text(site, "/templates?step=x").count("/templates/t") == 50


def test_the_nights_of_a_document_are_found_beside_its_batches(tmp_path: Path):
    site = Site(open_store(tmp_path.as_uri()), None)
    shown_store(site.store)
    assert "A report" in text(site, "/batches/trends/plain.html")
    assert get(site, "/batches/trends/other.html").status == 404


def test_a_named_template_is_shown_with_its_body_of_now(tmp_path: Path):
    site = Site(open_store(tmp_path.as_uri()), None)
    site.store.put(f"templates/{'d' * 64}.json", b'{"rooms": "four"}')
    times = {"created_at_s": 1e9, "updated_at_s": 1e9}
    record = {
        "id": "wt-0000000000000001",
        "name": "<b>flats</b>",
        "digest": "d" * 64,
        "version": "2",
        "tags": {},
        **times,
    }
    site.store.put("world-templates/wt-0000000000000001.json", json.dumps(record).encode())
    assert "&lt;b&gt;flats&lt;/b&gt;" in text(site, "/templates")
    assert "&#34;rooms&#34;: &#34;four&#34;" in text(site, "/templates/wt-0000000000000001")
    assert get(site, "/templates/wt-0000000000000002").status == 404


def test_other_paths_and_methods_are_no_pages(open_site: Site):
    for method, target in (
        ("GET", "/listRobots"),
        ("POST", "/batches"),
        ("DELETE", "/"),
        ("POST", "/sign-in"),
        ("GET", "/sign-out"),
    ):
        assert answer_page(open_site, request(target, method)) is None, target


def test_the_process_of_the_pages_loads_no_heavy_library():
    heavy = "[name for name in ('numpy', 'prefect', 'jax', 'mujoco', 'pyarrow') if name in sys.modules]"
    code = f"import flows.gateway.page.site, sys; print({heavy})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_page_has_the_tags_of_now(tmp_path: Path):
    store = open_store(tmp_path.as_uri())
    shown = shown_store(store)
    world, job = f"{shown.generation}/world-1-1", f"{shown.batch}/0"
    places = {
        f"/batches/{shown.batch}": Reference(kind="simulation-job-batch", path=shown.batch),
        f"/batches/{shown.batch}/jobs/0": Reference(kind="simulation-job", path=job),
        f"/worlds/{world}": Reference(kind="world", path=world),
        f"/generations/{shown.generation}": Reference(kind="world-generation-job", path=shown.generation),
        f"/exports/{shown.export}": Reference(kind="world-export-job", path=shown.export),
        f"/deployments/{shown.deployment}": Reference(kind="deployment-job", path=shown.deployment),
    }
    for reference in places.values():
        change_tags(store, reference, dict, with_tags({"shift": "night"}))
    site = Site(store, None)
    assert [place for place in places if "tag shift" not in text(site, place)] == []


def test_a_page_has_the_arn_of_the_api_beside_simyards_own(open_site: Site, shown: Shown):
    number = shown.batch.removeprefix("simb-")
    for page, end in ((shown.batch, f"simulation-job-batch/sjb-{number}"), (f"{shown.batch}/jobs/0", f"sim-{number}0")):
        found = text(open_site, f"/batches/{page}")
        assert re.search(rf"arn:aws:robomaker:us-west-2:[0-9]{{12}}:\S*{end}<", found)
        assert "arn:simyard:simulation-job" in found
