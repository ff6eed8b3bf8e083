"""Container images as applications: an image becomes a bundle, and a bundle's image a folder that programs are run in.

A bundle of an image has its blobs as an OCI image layout (``image/``), what its configuration says (``image.json``),
and the files that declare the robot, copied out of the image or from a folder beside it. So a bundle's digest stands
for every byte of the image, and whoever signs or compares bundles signs and compares images. A registry is asked by
``skopeo``. Formats: OCI image specification 1.1, and what ``docker save`` writes. A layer that zstd has packed is kept
unpacked, so that robots need nothing to read it.
"""

import hashlib
import itertools
import json
import os
import posixpath
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

from pydantic import ValidationError

from specs.bundle_files import ContainerImage
from specs.errors import BundleRefused
from specs.field_types import Architecture
from specs.launched_file import IMAGE_FILE
from specs.ros_robot import ROS_FILE
from tasks.storage.archives import LIMITS
from tasks.storage.base.local_files import OF_THE_DISK
from tasks.storage.image_files import (
    BLOCK_BYTES,
    LAYOUT,
    ImageBlobs,
    ImageFolders,
    blob_name,
    inside,
    merge_file,
    new_tree,
    opened_blobs,
    require_digest,
    sealed_tree,
    turn_at,
    unpacked,
)

REGISTRY = "docker://"
_PINNED = "@sha256:"
_BUILT_FOR: Mapping[tuple[str, str], Architecture] = {
    ("amd64", ""): "X86_64",
    ("arm64", ""): "ARM64",
    ("arm64", "v8"): "ARM64",
    ("arm", "v7"): "ARMHF",
}
_GO_NAMES: Mapping[Architecture, tuple[str, ...]] = {
    "X86_64": ("--override-arch", "amd64"),
    "ARM64": ("--override-arch", "arm64"),
    "ARMHF": ("--override-arch", "arm", "--override-variant", "v7"),
}
# Where an image has the files that declare its robot: its label says it, or one of these.
_LABEL, _PLACE = "simyard.bundle", "/simyard"
_DECLARED = ("robot.xml", ROS_FILE)
_FETCH_S = 3600.0
_INDEXES = ("index", "list.v2")
_ZSTD = b"\x28\xb5\x2f\xfd"
_ROS1_NAMES = frozenset({"indigo", "jade", "kinetic", "lunar", "melodic", "noetic"})
_RCLPY = "lib/python3*/*-packages/rclpy"


class _Layer(NamedTuple):
    """A layer's file, its digest as it lies there, and that of the tar in it."""

    name: str
    digest: str
    diff_id: str


def is_image_source(source: str, base: Path) -> bool:
    """Returns whether a source is an image: of a registry, an archive, or a folder with an OCI image layout."""
    place = base / source
    return source.startswith(REGISTRY) or place.is_file() or (place / "oci-layout").is_file()


def image_bundle(source: str, base: Path, robot: Path | None = None, architecture: Architecture = "X86_64") -> Path:
    """Returns the bundle's folder of an image, made in the cache once for each state of its source.

    Args:
        source: ``docker://NAME@sha256:DIGEST``, or the path of an archive (``docker save``, or of an OCI layout), or of
            a folder with an OCI layout.
        base: Folder that paths start from.
        robot: Folder with the files that declare the robot; None where the image has them.
        architecture: Which of several images is taken.

    Raises:
        BundleRefused: It is no image, is for another architecture, is too large, or cannot be fetched; says why.
    """
    if source.startswith(REGISTRY) and _PINNED not in source:
        how = f"skopeo inspect --format '{{{{.Digest}}}}' {source} tells the one of today"
        raise BundleRefused(f"{source}: a tag may be another image tomorrow: write {source}{_PINNED}...; {how}")
    target = ImageFolders.of_cache().images / f"bundle-{_state(source, base, robot, architecture)}"
    if bundle := sealed_tree(target):
        return bundle
    with turn_at(target):
        return sealed_tree(target) or _made(source, base, robot, architecture, target)


def _made(source: str, base: Path, robot: Path | None, architecture: Architecture, target: Path) -> Path:
    with new_tree(target, ".making-") as made:
        fetched = made.parent.parent / "fetched"
        place = _fetched(source, fetched, architecture) if source.startswith(REGISTRY) else (base / source).resolve()
        with opened_blobs(place) as blobs:
            (made / LAYOUT).mkdir()
            digest, config = _copied(blobs, made / LAYOUT, architecture)
            _declare(made, digest, config, architecture, robot)
    return target / made.name


def _state(source: str, base: Path, robot: Path | None, architecture: Architecture) -> str:
    """Returns what a source's bundle is known by in the cache: another one once it is written anew."""
    known: list[object] = [source, architecture]
    if not source.startswith(REGISTRY):
        place = (base / source).resolve()
        file = place / "index.json" if place.is_dir() else place
        if not file.is_file():
            raise BundleRefused(f"{place.name}: no container image: it lacks {file.name!r}")
        status = file.stat()
        known += [str(place), status.st_ino, status.st_size, status.st_mtime_ns]
    known += [(robot / name).read_bytes().hex() if robot and (robot / name).is_file() else "" for name in _DECLARED]
    return hashlib.sha256(json.dumps(known).encode()).hexdigest()[:32]


def _fetched(source: str, folder: Path, architecture: Architecture) -> Path:
    """Returns a folder with a registry's image, which skopeo compared with its digests."""
    program = shutil.which("skopeo")
    if program is None:
        raise BundleRefused(f"{source}: registries need skopeo, which is not installed: apt-get install skopeo")
    own = source.startswith((f"{REGISTRY}127.0.0.1:", f"{REGISTRY}localhost:"))
    command = [program, "--insecure-policy", *_GO_NAMES[architecture], "--override-os", "linux", "copy", "-q"]
    command += [*(["--src-tls-verify=false"] if own else []), source, f"oci:{folder}:image"]
    try:
        done = subprocess.run(  # noqa: S603 - the arguments are separate words
            command, capture_output=True, text=True, errors="replace", timeout=_FETCH_S, check=False
        )
    except subprocess.TimeoutExpired as exc:
        raise BundleRefused(f"{source}: skopeo takes longer than {_FETCH_S:g} s") from exc
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
        raise BundleRefused(f"{source}: skopeo: {said[:500]}")
    return folder


def _copied(blobs: ImageBlobs, layout: Path, architecture: Architecture) -> tuple[str, dict[str, Any]]:
    """Writes an image as an OCI layout, each blob compared with its digest; returns its digest and configuration."""
    if "oci-layout" in blobs.names:
        entry = _chosen(blobs, json.loads(blobs.small("index.json"))["manifests"], architecture)
        manifest = blobs.blob(entry)
        body, named = blobs.small(blob_name(entry["digest"])), manifest["config"]["digest"]
        config = blobs.small(blob_name(named), named)
        packed = [str(each["digest"]) for each in manifest["layers"]]
        names, said = [blob_name(each) for each in packed], json.loads(config)
    elif "manifest.json" in blobs.names:
        (saved,) = json.loads(blobs.small("manifest.json"))
        body, config = b"", blobs.small(saved["Config"])
        names, said = saved["Layers"], json.loads(config)
        packed = said["rootfs"]["diff_ids"]
    else:
        raise BundleRefused(
            f"{blobs.where}: no container image: it has neither manifest.json, as docker save writes it, nor oci-layout"
        )
    built = (str(said.get("architecture", "")), str(said.get("variant", "")))
    if _BUILT_FOR.get(built) != architecture:
        found = "/".join(filter(None, built)) or "no architecture"
        platform = next("/".join(filter(None, each)) for each, name in _BUILT_FOR.items() if name == architecture)
        why = f"it is built for {found}, and {architecture} is asked for: build it with --platform linux/{platform}"
        raise BundleRefused(f"{blobs.where}: {why}")
    (layout / "blobs/sha256").mkdir(parents=True)
    left, copied = LIMITS.total_bytes, list[dict[str, object]]()
    for layer in itertools.starmap(_Layer, zip(names, packed, said["rootfs"]["diff_ids"], strict=True)):
        copied.append(_copy_layer(blobs, layer, layout, left))
        left -= int(str(copied[-1]["size"]))
    # docker save writes no manifest, and that of layers kept otherwise is another: one is made, always the same.
    of_config = _written(layout, "config.v1+json", config)
    kept = body if [each["digest"] for each in copied] == packed else b""
    made = kept or _canonical({"schemaVersion": 2, "config": of_config, "layers": copied})
    of_manifest = _written(layout, "manifest.v1+json", made)
    (layout / "index.json").write_bytes(_canonical({"schemaVersion": 2, "manifests": [of_manifest]}))
    (layout / "oci-layout").write_bytes(_canonical({"imageLayoutVersion": "1.0.0"}))
    return str(of_manifest["digest"]).removeprefix("sha256:"), said


def _chosen(blobs: ImageBlobs, entries: Sequence[Mapping[str, Any]], architecture: Architecture) -> Mapping[str, Any]:
    """Returns the manifest that an index has for an architecture; indexes may stand in an index."""
    # One that has several names stands there for each of them.
    fitting = [*{each["digest"]: each for each in entries if _platform(each) in (None, architecture)}.values()]
    if len(fitting) != 1:
        known = ", ".join(str((each.get("platform") or {}).get("architecture", "?")) for each in entries)
        raise BundleRefused(f"{blobs.where}: {len(fitting)} of its images are for {architecture}; they are for {known}")
    if not str(fitting[0].get("mediaType", "")).removesuffix("+json").endswith(_INDEXES):
        return fitting[0]
    return _chosen(blobs, blobs.blob(fitting[0])["manifests"], architecture)


def _platform(entry: Mapping[str, Any]) -> Architecture | str | None:
    """Returns what an entry of an index is for; None if it does not say."""
    found = entry.get("platform")
    if not found:
        return None
    built = (str(found.get("architecture")), str(found.get("variant") or ""))
    return _BUILT_FOR.get(built, "another") if found.get("os") == "linux" else "another"


def _descriptor(kind: str, digest: str, size: int) -> dict[str, object]:
    return {"mediaType": f"application/vnd.oci.image.{kind}", "digest": digest, "size": size}


def _canonical(document: object) -> bytes:
    return json.dumps(document, sort_keys=True, separators=(",", ":")).encode()


def _written(layout: Path, kind: str, body: bytes) -> dict[str, object]:
    """Returns the descriptor of a blob that was written."""
    digest = f"sha256:{hashlib.sha256(body).hexdigest()}"
    (layout / blob_name(digest)).write_bytes(body)
    return _descriptor(kind, digest, len(body))


def _copy_layer(blobs: ImageBlobs, layer: _Layer, layout: Path, left: int) -> dict[str, object]:
    """Returns the descriptor of a layer that was copied and compared; one that zstd has packed is unpacked for that."""
    with blobs.open(layer.name) as source:
        packed = source.read(len(_ZSTD)) == _ZSTD
    if not packed:
        with blobs.open(layer.name) as source:
            return _kept(source, layer.digest, layout, left, blobs.where)
    import pyarrow as pa  # noqa: PLC0415 - few images need it, and it brings NumPy along

    with blobs.open(layer.name) as source:
        found = hashlib.file_digest(source, "sha256").hexdigest()  # pyright: ignore[reportArgumentType] - every file can
    require_digest(blobs.where, found, layer.digest)
    try:
        with blobs.open(layer.name) as source, pa.CompressedInputStream(source, "zstd") as tar:
            return _kept(tar, layer.diff_id, layout, left, blobs.where)
    except OSError as exc:
        if exc.errno in OF_THE_DISK:
            raise
        raise BundleRefused(f"{blobs.where}: a layer is damaged: {exc}") from exc


def _kept(source: IO[bytes], digest: str, layout: Path, left: int, where: str) -> dict[str, object]:
    """Writes a layer into a layout, and returns its descriptor; refuses one that is not what its digest stands for."""
    found, size, target = hashlib.sha256(), 0, layout / blob_name(digest)
    target.unlink(missing_ok=True)  # of a layer that is there twice; by now it is other images' file as well
    with target.open("wb") as sink:
        while block := source.read(BLOCK_BYTES):
            size += len(block)
            if size > left:
                raise BundleRefused(f"{where}: more than {LIMITS.total_bytes >> 20} MB of layers")
            found.update(block)
            sink.write(block)
    require_digest(where, found.hexdigest(), digest)
    os.utime(target, (0, 0))  # as in every other image that has it
    merge_file(target, ImageFolders.of_cache().files)
    return _descriptor("layer.v1.tar", digest, size)


def _declare(
    bundle: Path, digest: str, config: Mapping[str, Any], architecture: Architecture, robot: Path | None
) -> None:
    """Writes what a bundle tells of its image, and copies what declares the robot."""
    own: Mapping[str, Any] = config.get("config") or {}
    root, folder = unpacked(bundle, digest, ImageFolders.of_cache()), str(own.get("WorkingDir") or "/")
    labelled = str((own.get("Labels") or {}).get(_LABEL) or _PLACE)
    for name in _DECLARED:
        places = [robot / name] if robot else [inside(root, f"{place}/{name}") for place in (labelled, folder)]
        if found := next((place for place in places if place.is_file()), None):
            shutil.copyfile(found, bundle / name)
    user, group = _account(root, str(own.get("User") or "0"))
    pairs = (str(each).partition("=") for each in own.get("Env") or ())
    try:
        declared = ContainerImage(
            digest=digest,
            architecture=architecture,
            entrypoint=tuple(own.get("Entrypoint") or ()),
            command=tuple(own.get("Cmd") or ()),
            environment={name: value for name, _, value in pairs},
            folder=posixpath.normpath(f"/{folder}").replace("//", "/"),
            user=user,
            group=group,
            ros=_ros_of(root),
        )
    except ValidationError as exc:
        raise BundleRefused(f"its configuration: {' '.join(str(exc).split())[:300]}") from exc
    (bundle / IMAGE_FILE).write_text(declared.model_dump_json(indent=1) + "\n")


def _account(root: Path, named: str) -> tuple[int, int]:
    """Returns the numbers of a user, and of a group, of an image: ``User`` is ``NAME``, or ``NAME:GROUP``."""
    user, _, group = named.partition(":")
    lines = [line.split(":") for line in _lines(inside(root, "etc/passwd"))]
    entry = next((line for line in lines if len(line) > 3 and user in (line[0], line[2])), None)
    groups = {line[0]: line[2] for line in map(_colons, _lines(inside(root, "etc/group"))) if len(line) > 2}
    found = (entry[2] if entry else user, groups.get(group, group) or (entry[3] if entry else "0"))
    if not all(number.isdecimal() for number in found):
        raise BundleRefused(f"its User is {named[:80]!r}, whom its /etc/passwd does not have")
    return int(found[0]), int(found[1])


def _colons(line: str) -> list[str]:
    return line.split(":")


def _lines(path: Path) -> list[str]:
    return path.read_text(errors="replace").splitlines() if path.is_file() else []


def _ros_of(root: Path) -> int:
    """Returns which ROS lies in an image."""
    homes = inside(root, "opt/ros")
    names = {path.name for path in homes.iterdir()} if homes.is_dir() else set[str]()
    libraries = (place for prefix in ("usr", "usr/local", "opt/*") for place in root.glob(f"{prefix}/{_RCLPY}"))
    if names - _ROS1_NAMES or next(libraries, None):
        return 2
    return 1 if names or any(inside(root, f"usr/bin/{name}").is_file() for name in ("roscore", "roslaunch")) else 0
