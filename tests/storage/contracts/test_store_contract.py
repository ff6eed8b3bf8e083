"""What every store promises (tasks.storage.base.store.Store), on a folder and on a real S3 server."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Thread

import pytest

from specs.errors import DocumentError, ObjectConflict, ObjectExists, ObjectNotFound, ObjectTooBig
from tasks.storage.base.store import Store
from tests.servers.racers import create_in_rounds, in_processes

_BIG_BYTES = 40 << 20  # more than one part of an upload in parts


def test_a_created_object_is_read_back_with_the_etag_it_was_given(store: Store) -> None:
    etag = store.create("a/b.json", b"first")
    assert (store.get("a/b.json").body, store.get("a/b.json").etag) == (b"first", etag)


@pytest.mark.parametrize("body", [b"first", b"second", b""])
def test_a_lost_creation_is_reported_and_changes_nothing(store: Store, body: bytes) -> None:
    store.create("a.json", b"first")
    with pytest.raises(ObjectExists, match=r"a\.json"):
        store.create("a.json", body)
    assert store.get("a.json").body == b"first"


def test_an_empty_object_is_created_once(store: Store) -> None:
    store.create("empty", b"")
    with pytest.raises(ObjectExists):
        store.create("empty", b"")
    assert store.get("empty").body == b""


@pytest.mark.long
def test_of_fifty_creators_in_ten_processes_exactly_one_wins_each_round(store: Store) -> None:
    # SeaweedFS queues writers of one key with pauses of a second, so it gets fewer rounds.
    processes, threads, rounds = 10, 5, (1 if store.url.startswith("s3:") else 20)
    racers = [(store.url, racer, threads, rounds) for racer in range(processes)]
    wins = [win for won in in_processes(create_in_rounds, racers) for win in won]
    assert sorted(number for number, _ in wins) == list(range(rounds))
    assert all(store.get(f"race/{number}").body.decode() == winner for number, winner in wins)


def test_an_object_is_replaced_by_who_read_it_last(store: Store) -> None:
    first = store.create("a.json", b"1")
    second = store.replace("a.json", b"2", first)
    third = store.replace("a.json", b"3", second)
    assert (store.get("a.json").body, store.get("a.json").etag) == (b"3", third)


def test_a_stale_replacement_is_refused_and_changes_nothing(store: Store) -> None:
    stale = store.create("a.json", b"1")
    store.replace("a.json", b"2", stale)
    with pytest.raises(ObjectConflict, match=r"a\.json"):
        store.replace("a.json", b"3", stale)
    assert store.get("a.json").body == b"2"


def test_replacing_an_object_that_is_gone_is_a_conflict(store: Store) -> None:
    etag = store.create("a.json", b"1")
    store.delete("a.json")
    with pytest.raises(ObjectConflict, match="gone"):
        store.replace("a.json", b"2", etag)
    assert not store.exists("a.json")


def test_concurrent_replacements_lose_no_update(store: Store) -> None:
    store.create("counter", b"0")

    def add(times: int) -> None:
        while times:
            seen = store.get("counter")
            try:
                store.replace("counter", str(int(seen.body) + 1).encode(), seen.etag)
            except ObjectConflict:
                continue
            times -= 1

    with ThreadPoolExecutor(6) as pool:
        list(pool.map(add, [10] * 6))
    assert store.get("counter").body == b"60"


def test_put_overwrites_and_its_etag_serves_a_replacement(store: Store) -> None:
    store.put("a.json", b"1")
    etag = store.put("a.json", b"2")
    store.replace("a.json", b"3", etag)
    assert store.get("a.json").body == b"3"


def test_a_reader_never_sees_half_of_an_overwrite(store: Store) -> None:
    bodies = [b"a" * 300_000, b"b" * 100_000]
    store.put("a.bin", bodies[0])
    writer = Thread(target=lambda: [store.put("a.bin", bodies[number % 2]) for number in range(40)])
    writer.start()
    seen = [store.get("a.bin").body]
    while writer.is_alive():
        seen.append(store.get("a.bin").body)
    writer.join()
    assert all(body in bodies for body in seen)


def test_a_missing_object_is_not_found(store: Store) -> None:
    with pytest.raises(ObjectNotFound, match=r"none\.json"):
        store.get("none.json")


def test_a_folder_is_not_an_object(store: Store) -> None:
    store.create("folder/a.json", b"1")
    assert not store.exists("folder")
    with pytest.raises(ObjectNotFound):
        store.get("folder")


def test_exists_follows_creation_and_deletion(store: Store) -> None:
    seen = [store.exists("a.json")]
    store.create("a.json", b"1")
    seen.append(store.exists("a.json"))
    store.delete("a.json")
    seen.append(store.exists("a.json"))
    assert seen == [False, True, False]


def test_a_mark_stays_while_nobody_writes_and_changes_with_every_other_body(store: Store) -> None:
    store.put("a.json", b"1")
    first = store.mark("a.json")
    assert store.mark("a.json") == first
    store.put("a.json", b"2")
    assert store.mark("a.json") != first
    store.delete("a.json")
    store.put("folder/a.json", b"1")
    for key in ("a.json", "folder"):
        with pytest.raises(ObjectNotFound, match=key.partition(".")[0]):
            store.mark(key)


def test_deleting_what_is_not_there_is_no_error(store: Store) -> None:
    store.delete("folder/none.json")
    assert store.keys("folder") == []


def test_keys_are_those_of_the_folder_and_below_sorted(store: Store) -> None:
    for key in ("w/b/2.json", "w/b/1.json", "w/a.json", "w/b/c/3.json", "w/bb/4.json", "v.json"):
        store.create(key, b"1")
    assert store.keys("w/b") == store.keys("w/b/") == ["w/b/1.json", "w/b/2.json", "w/b/c/3.json"]


def test_an_empty_prefix_lists_everything(store: Store) -> None:
    store.create("a/b.json", b"1")
    assert store.keys("") == ["a/b.json", "store.json"]


def test_a_listing_shows_what_was_written_since_the_last_one(store: Store) -> None:
    store.create("a/1", b"1")
    before = store.keys("a")
    store.create("a/2", b"1")
    store.delete("a/1")
    assert (before, store.keys("a")) == (["a/1"], ["a/2"])


@pytest.mark.long
def test_a_listing_of_many_objects_is_complete(store: Store) -> None:
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda number: store.put(f"many/{number:04}", b"1"), range(1_050)))
    assert store.keys("many") == [f"many/{number:04}" for number in range(1_050)]


def test_a_big_file_survives_the_round_trip(store: Store, tmp_path: Path) -> None:
    source, target = tmp_path / "source", tmp_path / "new" / "target"
    source.write_bytes(bytes(range(256)) * (_BIG_BYTES // 256) + b"end")
    store.upload("big.bin", source)
    store.download("big.bin", target)
    assert target.read_bytes() == source.read_bytes()


def test_the_etag_of_an_object_is_the_one_it_is_read_with(store: Store) -> None:
    for body in (b"", b"1", bytes(700_000)):
        store.put("a.bin", body)
        assert store.etag("a.bin") == store.get("a.bin").etag
    with pytest.raises(ObjectNotFound):
        store.etag("none.bin")


@pytest.mark.parametrize("first_byte", [0, 1, 300_000, 999_999, 1_000_000, 1_000_001])
def test_an_object_is_read_from_any_byte_on(first_byte: int, store: Store) -> None:
    body = bytes(range(250)) * 4_000
    store.put("a.bin", body)
    assert store.size("a.bin") == len(body)
    assert b"".join(store.blocks("a.bin", first_byte)) == body[first_byte:]


def test_an_object_is_read_in_blocks_and_no_further_than_wanted(store: Store) -> None:
    store.put("a.bin", bytes(3 << 20))
    blocks = store.blocks("a.bin")
    first = next(blocks)
    blocks.close()
    assert 0 < len(first) < 1 << 20
    assert store.get("a.bin").body == bytes(3 << 20)


def test_what_is_not_there_has_no_size_and_no_blocks(store: Store) -> None:
    store.put("folder/a.bin", b"1")
    for key in ("none.bin", "folder"):
        with pytest.raises(ObjectNotFound):
            store.size(key)
        with pytest.raises(ObjectNotFound):
            next(store.blocks(key))


def test_an_object_that_is_bigger_than_reckoned_with_is_refused(store: Store) -> None:
    store.put("a.bin", b"12345")
    assert store.get("a.bin", 5).body == b"12345"
    with pytest.raises(ObjectTooBig, match="more than 4 bytes"):
        store.get("a.bin", 4)


def test_an_upload_overwrites(store: Store, tmp_path: Path) -> None:
    source = tmp_path / "source"
    for body in (b"first and longer", b"second"):
        source.write_bytes(body)
        store.upload("a.bin", source)
    assert store.get("a.bin").body == b"second"


@pytest.mark.parametrize(
    ("key", "other"),
    [
        ("a?versionId=x", "a"),
        ("a/b?versionId=x/c.bin", "a/b"),
        ("a#b", "a"),
        ("a::b", "b"),
        ("a*b", "acb"),
        ("a[b]", "ab"),
        ("a%3Fb", "a?b"),
        ("a b+c&d=e", "a"),
        ("{b}", "b"),
    ],
)
def test_a_key_is_taken_letter_by_letter_whatever_urls_and_patterns_mean_by_them(
    store: Store, tmp_path: Path, key: str, other: str
) -> None:
    source, target = tmp_path / "source", tmp_path / "target"
    source.write_bytes(b"odd")
    store.put(other, b"other")
    store.sweep(key)
    store.upload(key, source)
    store.download(key, target)
    assert (store.get(key).body, store.get(other).body, target.read_bytes()) == (b"odd", b"other", b"odd")
    assert store.keys("") == sorted([key, other, "store.json"])


def test_a_reader_never_sees_half_of_an_upload(store: Store, tmp_path: Path) -> None:
    sources = [tmp_path / "a", tmp_path / "b"]
    for source, size in zip(sources, (3 << 20, 1 << 20), strict=True):
        source.write_bytes(source.name.encode() * size)
    store.upload("a.bin", sources[0])
    writer = Thread(target=lambda: [store.upload("a.bin", sources[number % 2]) for number in range(20)])
    writer.start()
    seen = {store.get("a.bin").body}
    while writer.is_alive():
        seen.add(store.get("a.bin").body)
    writer.join()
    assert seen <= {source.read_bytes() for source in sources}


def test_sweeping_leaves_what_was_uploaded_and_what_others_upload(store: Store, tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.write_bytes(b"body")
    store.upload("a/b.bin", source)
    store.sweep("a/b.bin")
    store.sweep("a/none.bin")
    assert store.get("a/b.bin").body == b"body"


def test_uploading_a_missing_file_is_the_callers_error(store: Store, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        store.upload("a.bin", tmp_path / "none")
    assert store.keys("") == ["store.json"]


def test_a_failed_download_leaves_the_old_file_and_nothing_else(store: Store, tmp_path: Path) -> None:
    target = tmp_path / "downloads" / "target"
    target.parent.mkdir()
    target.write_bytes(b"old")
    with pytest.raises(ObjectNotFound):
        store.download("none.bin", target)
    assert [(path.name, path.read_bytes()) for path in target.parent.iterdir()] == [("target", b"old")]


@pytest.mark.parametrize("key", ["", "/a", "a/", "a//b", "../a", "a/../b", ".hidden", "a/.tmp-1", "a\0b", "k" * 1025])
def test_what_is_no_key_is_refused(store: Store, key: str) -> None:
    with pytest.raises(DocumentError, match="key"):
        store.create(key, b"1")
    assert store.keys("") == ["store.json"]
