"""Container images made in milliseconds: layers of a few files, as ``docker save`` and as OCI tools write them."""

import gzip
import hashlib
import io
import json
import tarfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pyarrow as pa

Entry = tuple[str, bytes, str, bytes, int]
"""Name, type, target of a link, content, mode."""


def file(name: str, body: bytes = b"", mode: int = 0o755) -> Entry:
    """Returns a regular file."""
    return (name, tarfile.REGTYPE, "", body, mode)


def folder(name: str) -> Entry:
    """Returns a folder."""
    return (name, tarfile.DIRTYPE, "", b"", 0o755)


def link(name: str, target: str, *, hard: bool = False) -> Entry:
    """Returns a symbolic link, or a hard one."""
    return (name, tarfile.LNKTYPE if hard else tarfile.SYMTYPE, target, b"", 0o777)


def device(name: str) -> Entry:
    """Returns a device of characters."""
    return (name, tarfile.CHRTYPE, "", b"", 0o666)


def layer(*entries: Entry) -> bytes:
    """Returns a layer, a plain tar."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as tar:
        for name, kind, target, body, mode in entries:
            member = tarfile.TarInfo(name)
            member.type, member.linkname, member.size, member.mode = kind, target, len(body), mode
            tar.addfile(member, io.BytesIO(body))
    return buffer.getvalue()


def commented(files: int, characters: int) -> bytes:
    """Returns a layer of empty files, each with a comment of so many characters."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as tar:
        for number in range(files):
            member = tarfile.TarInfo(str(number))
            member.pax_headers = {"comment": f"{number} " + "x" * characters}
            tar.addfile(member)
    return buffer.getvalue()


def configuration(layers: Sequence[bytes], config: Mapping[str, object], architecture: str = "amd64") -> bytes:
    """Returns an image's configuration."""
    root = {"type": "layers", "diff_ids": [_digest(each) for each in layers]}
    said = {"architecture": architecture, "os": "linux", "config": dict(config), "rootfs": root}
    return json.dumps(said).encode()


def docker_archive(
    path: Path, layers: Sequence[bytes], config: Mapping[str, object] | None = None, architecture: str = "amd64"
) -> Path:
    """Writes an image as ``docker save`` does, and returns its path."""
    names = [f"{number}/layer.tar" for number in range(len(layers))]
    files = dict(zip(names, layers, strict=True))
    files["config.json"] = configuration(layers, config or {}, architecture)
    files["manifest.json"] = json.dumps([{"Config": "config.json", "RepoTags": ["app:1"], "Layers": names}]).encode()
    path.write_bytes(layer(*(file(name, body) for name, body in files.items())))
    return path


def by_gzip(body: bytes) -> bytes:
    """Returns a layer as most tools pack it."""
    return gzip.compress(body, mtime=0)


def by_zstd(body: bytes) -> bytes:
    """Returns a layer as BuildKit packs it, in two frames."""
    half = len(body) // 2
    return b"".join(bytes(pa.compress(each, "zstd", asbytes=True)) for each in (body[:half], body[half:]))


def oci_files(
    layers: Sequence[bytes],
    config: Mapping[str, object] | None = None,
    architecture: str = "amd64",
    pack: Callable[[bytes], bytes] = by_gzip,
) -> dict[str, bytes]:
    """Returns an image's files as OCI tools lay them out."""
    packed = [pack(each) for each in layers]
    body = configuration(layers, config or {}, architecture)
    manifest = {"schemaVersion": 2, "config": _named(body), "layers": [_named(each) for each in packed]}
    whole = json.dumps(manifest).encode()
    kind = {"mediaType": "application/vnd.oci.image.manifest.v1+json"}
    index = {"schemaVersion": 2, "manifests": [{**_named(whole), **kind}]}
    blobs = {f"blobs/sha256/{_digest(each)[7:]}": each for each in (*packed, body, whole)}
    return {"oci-layout": b'{"imageLayoutVersion": "1.0.0"}', "index.json": json.dumps(index).encode(), **blobs}


def oci_archive(path: Path, files: Mapping[str, bytes]) -> Path:
    """Writes an OCI layout as an archive, and returns its path."""
    path.write_bytes(layer(*(file(name, body) for name, body in files.items())))
    return path


def oci_folder(path: Path, files: Mapping[str, bytes]) -> Path:
    """Writes an OCI layout as a folder, and returns its path."""
    for name, body in files.items():
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(body)
    return path


def _named(body: bytes) -> dict[str, object]:
    return {"digest": _digest(body), "size": len(body)}


def _digest(body: bytes) -> str:
    return f"sha256:{hashlib.sha256(body).hexdigest()}"
