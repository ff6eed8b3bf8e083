"""Archives of strangers are read within bounds, and unpacked nowhere but in their folder."""

import bz2
import gzip
import hashlib
import io
import lzma
import subprocess
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.errors import BundleRefused, ObjectNotFound
from tasks.storage.archives import ArchiveLimits, digest_of, extract, install, list_bundle_files, open_tar
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import Store
from tasks.storage.sealed_bundle import seal_bundle, sealed_files

_BLOCK = 512


def _header(name: bytes, size: bytes, type_: bytes) -> bytes:
    """Returns one header with a right checksum."""
    fields = name.ljust(100, b"\0") + b"0000644\0" + b"0000000\0" * 2 + size.ljust(12, b"\0") + b"0" * 11 + b"\0"
    rest = (type_ + b"\0" * 100 + b"ustar\00000").ljust(_BLOCK - 156, b"\0")
    head = fields + b" " * 8 + rest
    return head[:148] + b"%06o\0 " % sum(head) + head[156:]


def _padded(body: bytes) -> bytes:
    return body.ljust(-(-len(body) // _BLOCK) * _BLOCK, b"\0")


def _pax(body: bytes, type_: bytes = b"x") -> bytes:
    return _header(b"pax", b"%011o" % len(body), type_) + _padded(body)


def _record(key: bytes, value: bytes) -> bytes:
    body = b" " + key + b"=" + value + b"\n"
    length = len(body) + 1
    while len(b"%d" % length) + len(body) != length:
        length += 1
    return b"%d" % length + body


_FILE = _header(b"a", b"%011o" % 1, b"0") + _padded(b"x")
PACKED = {"gzip": gzip.compress(b"a"), "bzip2": bz2.compress(b"a"), "xz": lzma.compress(b"a"), "zip": b"PK\x03\x04"}
_END = b"\0" * 2 * _BLOCK
MALFORMED: dict[str, bytes] = {
    "a negative size in PAX": _pax(_record(b"size", b"-512")) + _FILE,
    "a size of thousands of digits in PAX": _pax(_record(b"size", b"9" * 5000)) + _FILE,
    "a huge size in PAX": _pax(_record(b"size", b"9" * 300)) + _FILE,
    "a name that is no UTF-8": _pax(_record(b"path", b"\xff\xfe")) + _FILE,
    "a length that is too long": _pax(b"9" * 4000 + b" path=b\n") + _FILE,
    "a length of nothing": _pax(b"0 path=b\n") + _FILE,
    "a negative size in base 256": _header(b"a", b"\xff" * 12, b"0"),
    "a negative header in base 256": _header(b"pax", b"\xff" * 12, b"x") + b"x" * (1 << 20),
    "a huge header in base 256": _header(b"pax", b"\x80" + b"\x7f" * 11, b"x") + b"x" * (1 << 20),
    "a header of a mebibyte": _pax(_record(b"path", b"a" * (1 << 20))) + _FILE,
    "a chain of headers": _pax(_record(b"comment", b"")) * 5000 + _FILE,
    "a chain of long names": _header(b"././@LongLink", b"%011o" % 2, b"L") * 5000,
    "a header of digits": _pax(b"1" * 30_000) + _FILE,
    "a sparse map without end": _pax(
        _record(b"GNU.sparse.major", b"1") + _record(b"GNU.sparse.minor", b"0") + _record(b"GNU.sparse.name", b"b")
    )
    + _header(b"a", b"%011o" % (64 << 20), b"0")
    + _padded(b"9" * 20 + b"\n" + b"1\n" * (1 << 20)),
    "an old sparse file that goes on": _header(b"a", b"%011o" % 0, b"S")[: _BLOCK - 30] + b"\x01" * 30,
    "a header that names a character set": _pax(_record(b"hdrcharset", b"BINARY") + _record(b"path", b"\xff")) + _FILE,
}


@pytest.mark.parametrize("what", MALFORMED)
@pytest.mark.timeout(60)
def test_an_archive_is_refused_with(what: str, tmp_path: Path) -> None:
    archive = tmp_path / "bundle.tar"
    archive.write_bytes(MALFORMED[what] + _END)

    with pytest.raises(BundleRefused):
        install(archive, digest_of(archive), tmp_path / "out")

    assert [path.name for path in tmp_path.iterdir()] == ["bundle.tar"]


@pytest.mark.parametrize("format_", [tarfile.PAX_FORMAT, tarfile.GNU_FORMAT])
def test_an_entry_may_have_the_longest_name_that_is_allowed(format_: int, tmp_path: Path) -> None:
    name = "/".join(["a" * 255] * 8)
    with tarfile.open(tmp_path / "bundle.tar", "w", format=format_) as tar:
        tar.addfile(tarfile.TarInfo(name))

    with open_tar(tmp_path / "bundle.tar") as tar:
        assert [each.name for each in tar.headers()] == [name]


def _archive() -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as tar:
        for name in ("a/run.sh", "b" * 150, "ä"):
            member = tarfile.TarInfo(name)
            member.size = 3
            tar.addfile(member, io.BytesIO(b"abc"))
    return buffer.getvalue()


_GOOD = _archive()
_SPOILERS: list[Callable[[bytes, int], bytes]] = [
    lambda body, place: body[:place],
    lambda body, place: body[:place] + bytes([body[place] ^ 0x80]) + body[place + 1 :],
    lambda body, place: body[:place] + b"9" * 11 + body[place + 11 :],
    lambda body, place: body[:place] + b"-1" + body[place + 2 :],
    lambda body, place: body[place:] + body[:place],
]


@given(st.lists(st.tuples(st.sampled_from(_SPOILERS), st.integers(0, len(_GOOD) - 1)), min_size=1, max_size=4))
def test_an_archive_that_was_spoiled_is_unpacked_or_refused(
    tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[Callable[[bytes, int], bytes], int]]
) -> None:
    folder, body = tmp_path_factory.mktemp("spoiled"), _GOOD
    for change, place in changes:
        body = change(body, min(place, max(0, len(body) - 1))) if body else body
    body = _with_checksums(body)
    (folder / "bundle.tar").write_bytes(body)

    try:
        install(folder / "bundle.tar", digest_of(folder / "bundle.tar"), folder / "out")
    except BundleRefused:
        assert [path.name for path in folder.iterdir()] == ["bundle.tar"]


def _with_checksums(body: bytes) -> bytes:
    """Returns an archive in which each block that may be a header has the sum that a header needs."""
    blocks = [body[first : first + _BLOCK] for first in range(0, len(body), _BLOCK)]
    return b"".join(_summed(block) if b"ustar" in block else block for block in blocks)


def _summed(block: bytes) -> bytes:
    head = block[:148] + b" " * 8 + block[156:]
    return head[:148] + b"%06o\0 " % sum(head) + head[156:]


@pytest.mark.parametrize("packer", PACKED)
def test_a_packed_archive_is_refused_with_what_to_do(tmp_path: Path, packer: str) -> None:
    path = tmp_path / "bundle.tar.gz"
    path.write_bytes(PACKED[packer])
    with pytest.raises(BundleRefused, match=f"packed by {packer}: make a plain tar"), open_tar(path):
        pass


def _file(name: str, body: bytes = b"x", mode: int = 0o644) -> tuple[tarfile.TarInfo, bytes]:
    member = tarfile.TarInfo(name)
    member.size, member.mode = len(body), mode
    return member, body


def _special(name: str, type_: bytes, link: str = "") -> tuple[tarfile.TarInfo, bytes]:
    member = tarfile.TarInfo(name)
    member.type, member.linkname = type_, link
    return member, b""


def _tar(folder: Path, *members: tuple[tarfile.TarInfo, bytes], mode: Literal["w", "w:gz"] = "w") -> Path:
    path = folder / "bundle.tar"
    with tarfile.open(path, mode) as tar:
        for member, body in members:
            tar.addfile(member, io.BytesIO(body))
    return path


CORPUS: dict[str, Callable[[Path], Path]] = {
    "climbs with dots": lambda folder: _tar(folder, _file("../escaped")),
    "climbs in the middle": lambda folder: _tar(folder, _file("a/../../escaped")),
    "is absolute": lambda folder: _tar(folder, _file(str(folder / "escaped"))),
    "has a backslash": lambda folder: _tar(folder, _file("..\\escaped")),
    "has an empty part": lambda folder: _tar(folder, _file("a//escaped")),
    "has a line feed": lambda folder: _tar(folder, _file("a\nb")),
    "climbs behind a dot": lambda folder: _tar(folder, _file("./../escaped")),
    "is absolute behind a dot": lambda folder: _tar(folder, _file(".//escaped")),
    "writes a file twice, once behind a dot": lambda folder: _tar(folder, _file("a"), _file("./a", b"other")),
    "has no name": lambda folder: _tar(folder, _file("./")),
    "holds a symbolic link": lambda folder: _tar(folder, _special("escaped", tarfile.SYMTYPE, "/etc")),
    "writes through a symbolic link": lambda folder: _tar(
        folder, _special("door", tarfile.SYMTYPE, ".."), _file("door/escaped")
    ),
    "holds a hard link": lambda folder: _tar(folder, _file("a"), _special("b", tarfile.LNKTYPE, "a")),
    "holds a character device": lambda folder: _tar(folder, _special("null", tarfile.CHRTYPE)),
    "holds a block device": lambda folder: _tar(folder, _special("disk", tarfile.BLKTYPE)),
    "holds a pipe": lambda folder: _tar(folder, _special("pipe", tarfile.FIFOTYPE)),
    "holds a sparse file": lambda folder: _tar(folder, _special("sparse", tarfile.GNUTYPE_SPARSE)),
    "writes a file twice": lambda folder: _tar(folder, _file("a"), _file("a", b"other")),
    "uses a file as a folder": lambda folder: _tar(folder, _file("a"), _file("a/b")),
    "is compressed": lambda folder: _tar(folder, _file("a", b"0" * 100_000), mode="w:gz"),
    "is deep": lambda folder: _tar(folder, _file("/".join("a" * 40))),
    "has a long name": lambda folder: _tar(folder, _file("a" * 300)),
}


@pytest.mark.parametrize("name", CORPUS)
def test_an_archive_is_refused_and_nothing_escapes_when_it(name: str, tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    archive = CORPUS[name](inside)
    before = sorted(path for path in tmp_path.rglob("*"))

    with pytest.raises(BundleRefused):
        install(archive, digest_of(archive), inside / "out")

    assert sorted(path for path in tmp_path.rglob("*")) == before


def test_a_truncated_archive_is_refused(tmp_path: Path) -> None:
    archive = _tar(tmp_path, _file("a", b"0" * 5000))
    archive.write_bytes(archive.read_bytes()[:2000])

    with pytest.raises(BundleRefused, match=r"cannot be unpacked|cut short|tar"):
        extract(archive, tmp_path / "out")


def test_bytes_that_are_no_archive_are_refused(tmp_path: Path) -> None:
    archive = tmp_path / "noise"
    archive.write_bytes(hashlib.sha512(b"noise").digest() * 100)

    with pytest.raises(BundleRefused, match="plain tar"):
        extract(archive, tmp_path / "out")


def test_more_bytes_than_allowed_are_refused_before_they_are_written(tmp_path: Path) -> None:
    archive = _tar(tmp_path, _file("a", b"0" * 600), _file("b", b"0" * 600))

    with pytest.raises(BundleRefused, match="1000 bytes"):
        extract(archive, tmp_path / "out", limits=ArchiveLimits(total_bytes=1000))

    assert not (tmp_path / "out" / "b").exists()


def test_more_entries_than_allowed_are_refused(tmp_path: Path) -> None:
    archive = _tar(tmp_path, *[_file(f"f{number}") for number in range(5)])

    with pytest.raises(BundleRefused, match="4 entries"):
        extract(archive, tmp_path / "out", limits=ArchiveLimits(entries=4))


def test_files_keep_their_content_and_only_the_executable_bit_of_their_mode(tmp_path: Path) -> None:
    archive = _tar(tmp_path, _file("a/run.sh", b"#!/bin/sh\n", 0o4777), _file("a/data", b"1", 0o666))

    extract(archive, tmp_path / "out")

    assert (tmp_path / "out/a/run.sh").read_bytes() == b"#!/bin/sh\n"
    assert (tmp_path / "out/a/run.sh").stat().st_mode & 0o7777 == 0o755
    assert (tmp_path / "out/a/data").stat().st_mode & 0o7777 == 0o644


def test_an_archive_with_another_digest_is_not_installed(tmp_path: Path) -> None:
    archive = _tar(tmp_path, _file("a"))

    with pytest.raises(BundleRefused, match="changed or cut short"):
        install(archive, "0" * 64, tmp_path / "out")

    assert not (tmp_path / "out").exists()


def test_installing_twice_leaves_the_first_as_it_is(tmp_path: Path) -> None:
    archive = _tar(tmp_path, _file("a"))
    install(archive, digest_of(archive), tmp_path / "out")
    before = (tmp_path / "out/a").stat().st_ino

    install(archive, digest_of(archive), tmp_path / "out")

    assert (tmp_path / "out/a").stat().st_ino == before


def test_progress_ends_with_all_the_bytes_written(tmp_path: Path) -> None:
    archive = _tar(tmp_path, _file("a", b"123"), _file("b", b"45"))
    seen: list[int] = []

    extract(archive, tmp_path / "out", progress=lambda done, _total: seen.append(done))

    assert seen == [3, 5]


def _stored(store: Store, archive: Path) -> str:
    digest = digest_of(archive)
    store.upload(bundle_key(digest), archive)
    return digest


def test_the_files_of_a_bundle_are_named_without_folders_and_links(store: Store, tmp_path: Path) -> None:
    members = [
        _special("courier", tarfile.DIRTYPE),
        _file("courier/run.sh"),
        _special("courier/link", tarfile.SYMTYPE, "x"),
    ]
    digest = _stored(store, _tar(tmp_path, *members))

    assert [*list_bundle_files(store, digest)] == ["courier/run.sh"]


def test_files_of_a_bundle_are_told_with_whether_they_can_be_executed(file_store: Store, tmp_path: Path) -> None:
    digest = _stored(file_store, _tar(tmp_path, _file("run.sh", mode=0o755), _file("data", mode=0o644)))

    assert list_bundle_files(file_store, digest) == {"run.sh": True, "data": False}


def test_a_bundle_that_is_no_archive_has_no_files_to_name(file_store: Store, tmp_path: Path) -> None:
    noise = tmp_path / "noise"
    noise.write_bytes(b"noise" * 1000)

    with pytest.raises(BundleRefused, match="plain tar"):
        list_bundle_files(file_store, _stored(file_store, noise))


def test_a_bundle_that_is_not_in_the_store_has_no_files_to_name(file_store: Store) -> None:
    with pytest.raises(ObjectNotFound):
        list_bundle_files(file_store, "0" * 64)


def test_a_folder_that_was_packed_as_a_dot_is_the_same_bundle(tmp_path: Path, file_store: Store) -> None:
    folder = tmp_path / "bundle"
    (folder / "courier").mkdir(parents=True)
    (folder / "courier/launch.sh").write_text("#!/bin/sh")
    (folder / "courier/launch.sh").chmod(0o755)
    archive = tmp_path / "bundle.tar"
    subprocess.run(["tar", "-C", folder, "-cf", archive, "."], check=True)

    digest = digest_of(archive)
    extract(archive, tmp_path / "unpacked")
    file_store.put(bundle_key(digest), archive.read_bytes())

    assert (tmp_path / "unpacked/courier/launch.sh").read_text() == "#!/bin/sh"
    assert list_bundle_files(file_store, digest) == {"courier/launch.sh": True}
    assert seal_bundle(archive, tmp_path / "sealed", digest) == sealed_files(tmp_path / "sealed", digest)
