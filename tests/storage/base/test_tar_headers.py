"""Headers of archives that somebody made to hang, fill or end whoever unpacks them."""

import bz2
import gzip
import io
import lzma
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.errors import BundleRefused
from tasks.storage.archives import digest_of, install, open_tar

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
