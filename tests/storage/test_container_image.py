"""An image becomes a bundle whose digest stands for every byte of it; what is no image is refused with a reason."""

import hashlib
import io
import json
import tarfile
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from specs.errors import BundleRefused
from tasks.storage import container_image, image_files
from tasks.storage.archives import LIMITS
from tasks.storage.container_image import image_bundle, is_image_source
from tasks.storage.image_files import image_root, read_image
from tests.storage.made_images import (
    by_zstd,
    configuration,
    docker_archive,
    file,
    layer,
    link,
    oci_archive,
    oci_files,
    oci_folder,
)

_CONFIG = {"Entrypoint": ["/enter.sh"], "Cmd": ["sh"], "Env": ["A=b=c"], "WorkingDir": "/app", "User": "rob:ops"}
_LAYER = layer(
    file("enter.sh", b"#!/bin/sh\nexec $@\n"),
    file("etc/passwd", b"root:x:0:0::/:/bin/sh\nrob:x:1234:1234::/:/bin/sh\n"),
    file("etc/group", b"ops:x:77:rob\n"),
    file("simyard/robot.xml", b"<mujoco/>"),
    file("app/ros.yaml", b"{}\n"),
    file("opt/ros/noetic/setup.sh"),
)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))


def test_an_archive_of_docker_tells_what_its_configuration_says(tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [_LAYER], _CONFIG)
    bundle = image_bundle("app.tar", tmp_path)
    image = read_image(bundle)
    assert image is not None
    assert (image.entrypoint, image.command, image.environment) == (("/enter.sh",), ("sh",), {"A": "b=c"})
    assert (image.folder, image.user, image.group, image.ros, image.architecture) == ("/app", 1234, 77, 1, "X86_64")
    assert {each.name for each in bundle.iterdir()} == {"image", "image.json", "robot.xml", "ros.yaml"}


def test_the_same_layers_are_the_same_files_from_each_kind_of_source(tmp_path: Path) -> None:
    docker_archive(tmp_path / "docker.tar", [_LAYER], _CONFIG)
    files = oci_files([_LAYER], _CONFIG)
    oci_archive(tmp_path / "oci.tar", files)
    oci_folder(tmp_path / "layout", files)
    oci_folder(tmp_path / "zstd", oci_files([_LAYER], _CONFIG, pack=by_zstd))
    found = {name: image_bundle(name, tmp_path) for name in ("docker.tar", "oci.tar", "layout", "zstd")}
    images = {name: read_image(bundle) for name, bundle in found.items()}
    assert images["oci.tar"] == images["layout"]
    trees = {name: _tree(image_root(bundle)) for name, bundle in found.items()}
    assert trees["docker.tar"] == trees["oci.tar"] == trees["layout"] == trees["zstd"]
    assert images["zstd"] == images["docker.tar"]  # no robot needs zstd


def _tree(root: Path | None) -> dict[str, bytes]:
    assert root is not None
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


def test_an_archive_that_is_written_anew_is_another_bundle(tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [_LAYER], _CONFIG)
    first = image_bundle("app.tar", tmp_path)
    assert image_bundle("app.tar", tmp_path) == first
    docker_archive(tmp_path / "app.tar", [_LAYER, layer(file("more"))], _CONFIG)
    assert read_image(image_bundle("app.tar", tmp_path)) != read_image(first)


@pytest.mark.parametrize("change", ["content", "more", "link", "rights", "whole"])
def test_unpacked_files_that_were_changed_are_unpacked_anew(change: str, tmp_path: Path) -> None:
    """The attack: what lies in the cache is written to, as whoever has this account can."""
    docker_archive(tmp_path / "app.tar", [_LAYER, layer(link("app/l", "ros.yaml"))], _CONFIG)
    bundle = image_bundle("app.tar", tmp_path)
    root = image_root(bundle)
    assert root is not None
    before, script = _tree(root), root / "enter.sh"
    if change == "content":
        script.write_bytes(script.read_bytes().replace(b"exec", b"stop"))
    elif change == "more":
        (root / "app/sitecustomize.py").write_text("evil")
    elif change == "link":
        (root / "app/l").unlink()
        (root / "app/l").symlink_to("/etc/shadow")
    elif change == "rights":
        (root / "app/ros.yaml").chmod(0o644)
    else:
        root.rename(tmp_path / "elsewhere")
        root.symlink_to(tmp_path / "elsewhere")
    assert image_root(bundle) == root
    assert (_tree(root), root.is_symlink(), str((root / "app/l").readlink())) == (before, False, "ros.yaml")
    assert sorted(path.name[:6] for path in (tmp_path / "cache/images").iterdir()) == sorted(
        ["bundle", root.parent.name[:6]]
    )


def test_a_layer_that_was_changed_in_the_cache_is_copied_anew(tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [_LAYER], _CONFIG)
    bundle = image_bundle("app.tar", tmp_path)
    before = _tree(bundle)
    (blob,) = [path for path in (bundle / "image/blobs/sha256").iterdir() if path.stat().st_size == len(_LAYER)]
    blob.write_bytes(_LAYER.replace(b"exec", b"stop"))
    assert image_bundle("app.tar", tmp_path) == bundle
    assert _tree(bundle) == before


def test_a_layer_that_is_named_twice_writes_nothing_into_those_of_other_images(tmp_path: Path) -> None:
    """The attack: a first copy is the file that images share, and what a second one of the same name has is another."""
    docker_archive(tmp_path / "app.tar", [_LAYER], _CONFIG)
    bundle = image_bundle("app.tar", tmp_path)
    before, said = _tree(bundle), configuration([_LAYER, _LAYER], {})
    entries = {"0.tar": _LAYER, "1.tar": b"evil", "config.json": said}
    entries["manifest.json"] = json.dumps([{"Config": "config.json", "Layers": ["0.tar", "1.tar"]}]).encode()
    (tmp_path / "evil.tar").write_bytes(layer(*(file(name, body) for name, body in entries.items())))
    with pytest.raises(BundleRefused, match="it was changed: save or fetch the image again"):
        image_bundle("evil.tar", tmp_path)
    assert _tree(bundle) == before
    docker_archive(tmp_path / "twice.tar", [_LAYER, _LAYER], _CONFIG)
    assert image_root(image_bundle("twice.tar", tmp_path)) is not None


def test_images_share_the_layers_and_files_that_are_alike(tmp_path: Path) -> None:
    upper = [layer(file("app/run", name)) for name in (b"first", b"other")]
    roots = list[Path]()
    for number, each in enumerate(upper):
        docker_archive(tmp_path / f"{number}.tar", [_LAYER, each])
        root = image_root(image_bundle(f"{number}.tar", tmp_path))
        assert root is not None
        roots.append(root)
    layers = (tmp_path / "cache/images").glob(f"bundle-*/files/image/blobs/sha256/{hashlib.sha256(_LAYER).hexdigest()}")
    assert [path.stat().st_nlink for path in layers] == [3, 3]  # and one in image-files
    assert [root.joinpath("enter.sh").stat().st_nlink for root in roots] == [3, 3]
    assert [root.joinpath("app/run").stat().st_nlink for root in roots] == [2, 2]
    script = roots[0] / "enter.sh"
    script.write_bytes(b"changed in both")
    docker_archive(tmp_path / "2.tar", [_LAYER, layer(file("app/more"))])
    third = image_root(image_bundle("2.tar", tmp_path))
    assert third is not None  # what is shared is compared before it is
    assert (third / "enter.sh").read_bytes() == b"#!/bin/sh\nexec $@\n"


def test_files_are_as_old_as_their_layer_says(tmp_path: Path) -> None:
    made = io.BytesIO()
    with tarfile.open(fileobj=made, mode="w") as tar:
        for name, time_s in (("old.py", 1_000_000_000), ("odd", -7), ("far", 1 << 40)):
            member = tarfile.TarInfo(name)
            member.mtime = time_s
            tar.addfile(member)
    docker_archive(tmp_path / "app.tar", [made.getvalue()])
    root = image_root(image_bundle("app.tar", tmp_path))
    assert root is not None
    found = [int((root / name).stat().st_mtime) for name in ("old.py", "odd", "far")]
    assert found[:2] == [1_000_000_000, 0]


def test_the_robot_may_lie_beside_an_image(tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [_LAYER], _CONFIG)
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot/robot.xml").write_text("<mujoco model='other'/>")
    bundle = image_bundle("app.tar", tmp_path, tmp_path / "robot")
    assert (bundle / "robot.xml").read_text() == "<mujoco model='other'/>"
    assert not (bundle / "ros.yaml").exists()


def test_a_bundle_with_a_folder_of_that_name_is_no_image(tmp_path: Path) -> None:
    (tmp_path / "image.json").mkdir()
    assert read_image(tmp_path) is None


def test_of_an_index_the_image_for_the_architecture_is_taken(tmp_path: Path) -> None:
    ours, theirs = oci_files([_LAYER], _CONFIG), oci_files([_LAYER], _CONFIG, "arm64")
    entries = [
        {**json.loads(files["index.json"])["manifests"][0], "platform": {"os": "linux", "architecture": name}}
        for files, name in ((theirs, "arm64"), (ours, "amd64"))
    ]
    both = {**theirs, **ours, "index.json": json.dumps({"schemaVersion": 2, "manifests": entries}).encode()}
    oci_folder(tmp_path / "both", both)
    assert getattr(read_image(image_bundle("both", tmp_path)), "architecture", "") == "X86_64"
    assert getattr(read_image(image_bundle("both", tmp_path, architecture="ARM64")), "architecture", "") == "ARM64"


def _refusal(source: str, base: Path) -> str:
    with pytest.raises(BundleRefused) as refused:
        image_bundle(source, base)
    assert not list((base / "cache").glob("images/.*"))  # nothing half-done is left
    return str(refused.value)


def test_an_image_for_another_processor_is_refused(tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [_LAYER], architecture="s390x")
    why = "app.tar: it is built for s390x, and X86_64 is asked for: build it with --platform linux/amd64"
    assert _refusal("app.tar", tmp_path) == why


def test_a_layer_that_was_changed_is_refused(tmp_path: Path) -> None:
    files = oci_files([_LAYER])
    changed = next(name for name, body in files.items() if body[:2] == b"\x1f\x8b")
    oci_folder(tmp_path / "layout", {**files, changed: files[changed] + b"x"})
    assert "it was changed" in _refusal("layout", tmp_path)
    docker = docker_archive(tmp_path / "app.tar", [_LAYER])
    docker.write_bytes(docker.read_bytes().replace(b"exec $@", b"exec rm"))
    assert "it was changed" in _refusal("app.tar", tmp_path)


def test_a_layer_that_zstd_has_packed_is_held_to_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The attacks: other bytes, bytes that unpack to another layer, half a frame, and more than may be."""
    good = oci_files([_LAYER], pack=by_zstd)
    name = next(name for name, body in good.items() if body[:4] == by_zstd(_LAYER)[:4])
    bombs = oci_files([b"\0" * (3 << 20)], pack=by_zstd)
    other = oci_files([_LAYER], pack=lambda body: by_zstd(body + b"\0"))
    cut = oci_files([_LAYER], pack=lambda body: by_zstd(body)[:-9])
    monkeypatch.setattr(container_image, "LIMITS", replace(LIMITS, total_bytes=1 << 20))
    found = dict[str, str]()
    for kind, files in {"bytes": {**good, name: good[name] + b"x"}, "other": other, "cut": cut, "bomb": bombs}.items():
        oci_archive(tmp_path / kind, files)
        found[kind] = _refusal(kind, tmp_path)
    assert all("it was changed" in found[kind] for kind in ("bytes", "other"))
    assert found["cut"].startswith("cut: a layer is damaged: ")
    assert found["bomb"] == "bomb: more than 1 MB of layers"


def test_a_tag_of_a_registry_is_refused(tmp_path: Path) -> None:
    assert "a tag may be another image tomorrow" in _refusal("docker://127.0.0.1:1/app:1", tmp_path)


def test_a_layout_without_an_index_is_refused(tmp_path: Path) -> None:
    oci_folder(tmp_path / "layout", {"oci-layout": b"{}"})
    assert _refusal("layout", tmp_path) == "layout: no container image: it lacks 'index.json'"


def test_an_image_that_has_several_names_is_one(tmp_path: Path) -> None:
    files = oci_files([_LAYER], _CONFIG)
    index = json.loads(files["index.json"])
    named = {**index, "manifests": [*index["manifests"], {**index["manifests"][0], "annotations": {"name": "other"}}]}
    oci_folder(tmp_path / "layout", {**files, "index.json": json.dumps(named).encode()})
    assert read_image(image_bundle("layout", tmp_path)) is not None


def _configured(config: bytes) -> dict[str, bytes]:
    """Returns the files of an archive whose image says something of how it is run."""
    said = b'{"architecture": "amd64", "rootfs": {"diff_ids": []}, "config": ' + config + b"}"
    return {"manifest.json": b'[{"Config": "config.json", "Layers": []}]', "config.json": said}


@pytest.mark.parametrize(
    ("files", "why"),
    [
        ({"readme": b""}, "it has neither manifest.json, as docker save writes it, nor oci-layout"),
        ({"manifest.json": b"["}, "no container image: JSONDecodeError"),
        ({"manifest.json": b"[]"}, "no container image: ValueError"),
        ({"manifest.json": b'[{"Config": "../../etc/passwd", "Layers": []}]'}, "it lacks '../../etc/passwd'"),
        ({"oci-layout": b"", "index.json": b'{"manifests": [{"digest": "sha256:../../x"}]}'}, "is no SHA-256"),
        ({"oci-layout": b"", "index.json": b'{"manifests": []}'}, "0 of its images are for X86_64"),
        ({"manifest.json": b"[" * 100_000}, "no container image: RecursionError"),
        (_configured(b'"text"'), "no container image: AttributeError"),
        (_configured(b'{"Entrypoint": 7}'), "no container image: TypeError"),
    ],
)
def test_what_is_no_image_is_refused(files: dict[str, bytes], why: str, tmp_path: Path) -> None:
    oci_archive(tmp_path / "app.tar", files)
    assert why in _refusal("app.tar", tmp_path)


def test_an_unknown_user_is_refused(tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [_LAYER], {"User": "nobody-known"})
    assert "whom its /etc/passwd does not have" in _refusal("app.tar", tmp_path)


def test_what_declares_the_robot_never_comes_from_outside_the_image(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("of this machine")
    docker_archive(tmp_path / "app.tar", [layer(link("simyard/robot.xml", str(secret)), link("etc/passwd", "/../x"))])
    assert not (image_bundle("app.tar", tmp_path) / "robot.xml").exists()


def test_a_source_is_an_image_by_what_it_is(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    docker_archive(tmp_path / "app.tar", [_LAYER])
    oci_folder(tmp_path / "layout", oci_files([_LAYER]))
    found = {name: is_image_source(name, tmp_path) for name in ("folder", "app.tar", "layout", "docker://x@sha256:y")}
    assert found == {"folder": False, "app.tar": True, "layout": True, "docker://x@sha256:y": True}


def test_of_many_who_want_an_image_at_once_one_takes_it_and_one_unpacks_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a client that asks again, since its answer takes long."""
    docker_archive(tmp_path / "app.tar", [_LAYER], _CONFIG)
    opened: list[Path] = []
    for module in (container_image, image_files):
        own = module.opened_blobs
        monkeypatch.setattr(module, "opened_blobs", lambda place, own=own: opened.append(place) or own(place))
    together = threading.Barrier(4)

    def root(_: int) -> Path | None:
        together.wait()
        return image_root(image_bundle("app.tar", tmp_path))

    with ThreadPoolExecutor(4) as pool:
        (found,) = {*pool.map(root, range(4))}
    assert found is not None
    assert len(opened) == 2, "the archive, and the layout that is unpacked"
    assert not [*(tmp_path / "cache").rglob(".turn-*")]
