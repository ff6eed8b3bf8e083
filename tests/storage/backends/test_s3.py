"""What can go wrong on the way to an S3 server; what the store promises is in tests/storage/contracts."""

import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from threading import Thread
from uuid import uuid4

import botocore.session
import pytest
from botocore.exceptions import ClientError

from specs.errors import ObjectConflict, ObjectExists, StoreAccessDenied, StoreDamaged, StoreError, StoreUnreachable
from tasks.storage.backends import s3_client
from tasks.storage.backends.s3 import S3Store
from tasks.storage.backends.s3_client import Answer, S3Client
from tasks.storage.base.store import Store
from tasks.storage.store_url import connect, open_store
from tests.servers.faulty_proxy import FaultyProxy, faulty_proxy
from tests.servers.odd_server import ENDLESS, odd_server
from tests.servers.seaweed import READER_KEY, READER_SECRET, Seaweed

_NOTHING_LISTENS = "http://127.0.0.1:9"


@pytest.fixture
def proxy(seaweed: Seaweed, s3_store: Store, monkeypatch: pytest.MonkeyPatch) -> Iterator[FaultyProxy]:
    """A faulty network between this test's later stores and the server."""
    with faulty_proxy(seaweed.endpoint) as proxy:
        monkeypatch.setenv("AWS_ENDPOINT_URL_S3", proxy.endpoint)
        yield proxy


def test_a_creation_whose_answer_was_lost_is_no_false_loser(s3_store: Store, proxy: FaultyProxy) -> None:
    behind = open_store(s3_store.url)
    proxy.lose_the_next_answer()
    etag = behind.create("a.json", b"mine")
    assert (proxy.lost, s3_store.get("a.json").etag) == (1, etag)


def test_a_replacement_whose_answer_was_lost_is_no_false_conflict(s3_store: Store, proxy: FaultyProxy) -> None:
    behind = open_store(s3_store.url)
    first = s3_store.create("a.json", b"1")
    proxy.lose_the_next_answer()
    etag = behind.replace("a.json", b"2", first)
    assert (proxy.lost, s3_store.get("a.json").etag) == (1, etag)


def test_a_write_whose_sender_died_before_its_bytes_leaves_what_was_there(s3_store: Store, proxy: FaultyProxy) -> None:
    behind = open_store(s3_store.url)
    first = s3_store.create("a.json", b"1")
    proxy.drop_the_next_body()
    with pytest.raises(StoreError, match="BadDigest"):
        behind.replace("a.json", b"22", first)
    assert (proxy.lost, s3_store.get("a.json").body, s3_store.get("a.json").etag) == (1, b"1", first)


def test_a_true_loser_that_wrote_the_same_bytes_still_loses(s3_store: Store, proxy: FaultyProxy) -> None:
    behind = open_store(s3_store.url)
    s3_store.create("a.json", b"same")
    proxy.lose_the_next_answer()
    with pytest.raises(ObjectExists):
        behind.create("a.json", b"same")
    assert proxy.lost == 1


def test_a_true_conflict_with_the_same_bytes_is_still_one(s3_store: Store, proxy: FaultyProxy) -> None:
    behind = open_store(s3_store.url)
    first = s3_store.create("a.json", b"1")
    s3_store.replace("a.json", b"2", first)
    proxy.lose_the_next_answer()
    with pytest.raises(ObjectConflict):
        behind.replace("a.json", b"2", first)


def test_a_read_whose_answer_was_lost_is_repeated(s3_store: Store, proxy: FaultyProxy) -> None:
    behind = open_store(s3_store.url)
    s3_store.create("a.json", b"1")
    proxy.lose_the_next_answer()
    assert behind.get("a.json").body == b"1"


def test_a_dead_endpoint_is_told_with_its_address(s3_url: Callable[[], str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL_S3", _NOTHING_LISTENS)
    with pytest.raises(StoreUnreachable, match=r"127\.0\.0\.1:9 \(AWS_ENDPOINT_URL_S3\)"):
        open_store(s3_url())


def test_a_server_that_never_answers_is_given_up(s3_url: Callable[[], str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(s3_client, "_FIRST_ANSWER_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        monkeypatch.setenv("AWS_ENDPOINT_URL_S3", f"http://127.0.0.1:{silent.getsockname()[1]}")
        with pytest.raises(StoreUnreachable):
            open_store(s3_url())


def test_a_missing_bucket_is_told(s3_store: Store) -> None:
    with pytest.raises(StoreUnreachable, match=r"s3://none-.*bucket does not exist"):
        open_store(f"s3://none-{uuid4().hex[:8]}/prefix")


class _NotS3(BaseHTTPRequestHandler):
    """A web server that has never heard of buckets."""

    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        self.send_error(404)

    def do_PUT(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_error(404)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002, ARG002 - as http.server calls it
        return


def test_a_server_that_is_no_s3_server_is_told(s3_url: Callable[[], str], monkeypatch: pytest.MonkeyPatch) -> None:
    with ThreadingHTTPServer(("127.0.0.1", 0), _NotS3) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        monkeypatch.setenv("AWS_ENDPOINT_URL_S3", f"http://127.0.0.1:{server.server_port}")
        with pytest.raises(StoreUnreachable, match="is it an S3 server"):
            open_store(s3_url())
        server.shutdown()


def test_wrong_credentials_are_denied_without_being_told(
    s3_url: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "canary-secret")
    with pytest.raises(StoreAccessDenied, match="AWS_SECRET_ACCESS_KEY") as raised:
        open_store(s3_url())
    assert "canary" not in str(raised.value)


def test_missing_credentials_are_told(s3_url: Callable[[], str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", "/nonexistent")
    monkeypatch.setenv("AWS_CONFIG_FILE", "/nonexistent")
    with pytest.raises(StoreAccessDenied, match="credentials"):
        open_store(s3_url())


def _read_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", READER_KEY)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", READER_SECRET)


def test_who_may_only_read_cannot_make_a_store(s3_url: Callable[[], str], monkeypatch: pytest.MonkeyPatch) -> None:
    _read_only(monkeypatch)
    with pytest.raises(StoreAccessDenied):
        open_store(s3_url())


def test_who_may_only_read_can_read_a_store_that_is_there(s3_store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    s3_store.create("a.json", b"1")
    _read_only(monkeypatch)
    reader = open_store(s3_store.url)
    assert reader.get("a.json").body == b"1"
    with pytest.raises(StoreAccessDenied):
        reader.create("b.json", b"1")


@pytest.mark.long
def test_an_upload_that_is_killed_leaves_nothing_under_the_key(
    s3_store: Store, seaweed: Seaweed, tmp_path: Path
) -> None:
    source = tmp_path / "big"
    with source.open("wb") as file:
        file.truncate(512 << 20)
    work = f"from tests.servers.racers import upload; upload({s3_store.url!r}, 'big.bin', {str(source)!r})"
    child = subprocess.Popen([sys.executable, "-c", work])
    while not _uploads_under_way(seaweed, s3_store):
        assert child.poll() is None
        time.sleep(0.01)
    child.kill()
    child.wait()
    assert not s3_store.exists("big.bin")
    assert s3_store.keys("") == ["store.json"]
    s3_store.sweep("other.bin")
    assert _uploads_under_way(seaweed, s3_store)
    s3_store.sweep("big.bin")
    assert not _uploads_under_way(seaweed, s3_store)


def _send_other(patch: pytest.MonkeyPatch, folder: Path) -> None:
    """Makes the network turn every file that is uploaded into another."""
    (folder / "sent").write_bytes(b"sent")
    (folder / "other").write_bytes(b"other")
    send = S3Client.send
    patch.setattr(S3Client, "send", lambda self, _, bucket, key: send(self, folder / "other", bucket, key))


def test_an_upload_that_arrives_damaged_is_told_and_removed(
    s3_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _send_other(monkeypatch, tmp_path)
    with pytest.raises(StoreDamaged, match=r"a\.bin"):
        s3_store.upload("a.bin", tmp_path / "sent")
    assert not s3_store.exists("a.bin")


def test_a_damaged_upload_that_cannot_be_removed_is_told_as_such(
    s3_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(key: str) -> None:
        raise StoreAccessDenied(key)

    _send_other(monkeypatch, tmp_path)
    monkeypatch.setattr(s3_store, "delete", refuse)
    with pytest.raises(StoreDamaged, match="could not be removed"):
        s3_store.upload("a.bin", tmp_path / "sent")


class _Uploads(S3Client):
    """A server that lists three unfinished uploads, of which the first is over when it is to be aborted."""

    def __init__(self, code: str, status: int) -> None:
        self.aborted: list[object] = []
        self._refusal = ClientError(
            {"Error": {"Code": code, "Message": ""}, "ResponseMetadata": {"HTTPStatusCode": status}},  # pyright: ignore[reportArgumentType] - the stub wants every header
            "AbortMultipartUpload",
        )

    def call(self, operation: str, **parameters: object) -> Answer:
        if operation == "list_multipart_uploads":
            keys = {"1": "p/a.bin", "2": "p/a.bin", "3": "p/a.bin.other"}
            return {"Uploads": [{"Key": key, "UploadId": upload} for upload, key in keys.items()]}
        self.aborted.append(parameters["UploadId"])
        if parameters["UploadId"] == "1":
            raise self._refusal
        return {}


def test_sweeping_goes_on_after_an_upload_that_is_over() -> None:
    client = _Uploads("NoSuchUpload", 404)
    S3Store("bucket", "p", client).sweep("a.bin")
    assert client.aborted == ["1", "2"]


def test_sweeping_tells_what_else_is_refused() -> None:
    with pytest.raises(StoreError, match="405"):
        S3Store("bucket", "p", _Uploads("MethodNotAllowed", 405)).sweep("a.bin")


class _Whole(S3Client):
    """A server that knows no ranges: it sends all of an object, whatever part of it is asked for."""

    def __init__(self, body: bytes) -> None:
        self.asked: list[object] = []
        self._body = body

    def call(self, operation: str, **parameters: object) -> Answer:  # noqa: ARG002 - as the client is called
        self.asked.append(parameters.get("Range"))
        return {"Body": BytesIO(self._body)}


@pytest.mark.parametrize("first_byte", [0, 1, 262_143, 262_144, 300_000, 1_000_000])
def test_only_what_is_missing_is_asked_for_and_taken(first_byte: int) -> None:
    body = bytes(range(250)) * 4_000
    server = _Whole(body)

    assert b"".join(S3Store("bucket", "p", server).blocks("a.bin", first_byte)) == body[first_byte:]
    assert server.asked == [f"bytes={first_byte}-" if first_byte else None]


def _uploads_under_way(seaweed: Seaweed, store: Store) -> bool:
    bucket, _, prefix = store.url.removeprefix("s3://").partition("/")
    client = botocore.session.Session().create_client("s3", endpoint_url=seaweed.endpoint)
    try:
        uploads = client.list_multipart_uploads(Bucket=bucket).get("Uploads", [])
    finally:
        client.close()
    return any(upload["Key"].startswith(prefix) for upload in uploads)


@pytest.mark.parametrize("answer", [*sorted(ENDLESS), "100, cut"])
def test_an_answer_that_never_ends_is_cut(answer: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_REGION"):
        monkeypatch.setenv(name, "eu-central-1")
    monkeypatch.setattr("time.sleep", lambda _s: None)  # botocore's, before it asks again
    monkeypatch.setattr("tasks.storage.backends.s3_client._PATIENCE_S", 0.1)
    with odd_server(answer) as server:
        monkeypatch.setenv("AWS_ENDPOINT_URL", server.endpoint)
        store = connect("s3://bucket/store")
        asked: list[Callable[[], object]] = [lambda: store.get("key", 1000), lambda: list(store.blocks("key"))]
        for request in (*asked, lambda: store.put("key", b"body")):
            with pytest.raises(StoreUnreachable):
                request()


_ENDED_AN_AGENT = ("200, a page", "200, empty", "200, a length that is none", "200, dates that are none", "204", "206")


@pytest.mark.parametrize("answer", [*_ENDED_AN_AGENT, "200, cut", "200, a negative length", "302", "a reset"])
def test_whatever_answers_in_the_place_of_a_server_was_not_reached(
    answer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_REGION"):
        monkeypatch.setenv(name, "eu-central-1")
    monkeypatch.setattr("time.sleep", lambda _s: None)  # botocore's, before it asks again
    with odd_server(answer) as server:
        monkeypatch.setenv("AWS_ENDPOINT_URL", server.endpoint)
        store = connect("s3://bucket/store")
        asked: list[Callable[[], object]] = [lambda: store.get("key", 1000), lambda: store.exists("key")]
        asked.append(lambda: store.entries("folder"))
        if answer != "200, dates that are none":  # of a write, a date says nothing
            asked.append(lambda: store.put("key", b"body"))
        for request in asked:
            with pytest.raises(StoreUnreachable):
                request()
