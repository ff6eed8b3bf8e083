"""Layers are applied as their specification says, and nothing of them lands outside the image or gives rights."""

import contextlib
import fcntl
import gzip
import hashlib
import io
import os
import shutil
import stat
import subprocess
import tarfile
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from specs.bundle_files import ContainerImage
from specs.errors import BundleRefused
from tasks.storage import image_files
from tasks.storage.image_files import apply_layer, image_command, inside, missing_program, new_tree, sealed_tree
from tests.storage.made_images import Entry, commented, device, file, folder, layer, link

_IMAGE = ContainerImage(digest="0" * 64, architecture="X86_64")


def _applied(root: Path, *layers: bytes) -> dict[str, str]:
    """Returns what an image holds: a file's content, a link's target."""
    root.mkdir(exist_ok=True)
    for each in layers:
        apply_layer(io.BytesIO(each), root, f"sha256:{hashlib.sha256(each).hexdigest()}", 1 << 20)
    return {
        str(path.relative_to(root)): f"-> {path.readlink()}" if path.is_symlink() else path.read_text()
        for path in sorted(root.rglob("*"))
        if path.is_symlink() or path.is_file()
    }


def test_a_later_layer_replaces_and_hides(tmp_path: Path) -> None:
    lower = layer(file("a/x", b"1"), file("a/y", b"1"), file("b/x", b"1"), file("c", b"1"), folder("d"))
    upper = layer(file("a/.wh.x"), file("b/.wh..wh..opq"), file("b/z", b"2"), file("c/inner", b"2"), file("d", b"2"))
    with pytest.raises(BundleRefused, match="'c/inner' in a layer cannot be unpacked"):
        _applied(tmp_path / "wrong", lower, upper)
    upper = layer(file("a/.wh.x"), file("b/z", b"2"), file("b/.wh..wh..opq"), folder("c"), file("d", b"2"))
    assert _applied(tmp_path / "root", lower, upper) == {"a/y": "1", "b/z": "2", "d": "2"}
    assert (tmp_path / "root/c").is_dir()


def test_a_folder_that_a_lower_layer_links_to_is_filled_inside_the_image(tmp_path: Path) -> None:
    lower = layer(folder("usr/lib"), link("lib", "usr/lib"), link("abs", "/usr/lib"), link("up", "../../../../usr"))
    upper = layer(file("lib/a", b"1"), file("abs/b", b"1"), file("up/c", b"1"), link("usr/d", "lib/a", hard=True))
    found = _applied(tmp_path / "root", lower, upper)
    assert {name: body for name, body in found.items() if "->" not in body} == {
        "usr/lib/a": "1",
        "usr/lib/b": "1",
        "usr/c": "1",
        "usr/d": "1",
    }


def test_no_link_leads_out_of_the_image(tmp_path: Path) -> None:
    """The attack: a link to a folder of this machine, then a file, a hard link and a whiteout through it."""
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "kept").write_text("kept")
    lower = layer(link("out", str(outside)), link("near", "../outside"))
    upper = layer(file("out/written", b"1"), file("near/.wh.kept"), file("out/.wh.kept"), file("near/.wh..wh..opq"))
    _applied(tmp_path / "root", lower, upper)
    assert [each.name for each in outside.iterdir()] == ["kept"]
    assert (tmp_path / "root").joinpath(*outside.parts[1:], "written").is_file()
    with pytest.raises(BundleRefused, match="no file of it"):
        _applied(tmp_path / "root", layer(link("stolen", "out/kept", hard=True)))
    with pytest.raises(BundleRefused, match="no file of it"):
        _applied(tmp_path / "root", layer(link("stolen", f"{outside}/kept", hard=True)))


@pytest.mark.parametrize("name", ["../x", "a/../../x", "a/.."])
def test_a_name_that_climbs_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(BundleRefused, match="leads out of the image"):
        _applied(tmp_path / "root", layer(file(name)))
    assert [each.name for each in tmp_path.iterdir()] == ["root"]


@pytest.mark.parametrize("name", ["/abs/x", "./x", ".wh...", "a/.wh..", ".wh."])
def test_other_odd_names_stay_inside(name: str, tmp_path: Path) -> None:
    _applied(tmp_path / "root", layer(file("kept", b"1"), folder("a")), layer(file(name)))
    assert [each.name for each in tmp_path.iterdir()] == ["root"]
    assert (tmp_path / "root/kept").is_file()


_PARTS = st.sampled_from(["a", "b", "..", ".", "", "l", ".wh.a", ".wh..wh..opq", ".wh.l", "outside"])
_NAMES = st.lists(_PARTS, min_size=1, max_size=4).map("/".join)
_ENTRIES = st.one_of(
    st.builds(file, _NAMES), st.builds(folder, _NAMES), st.builds(link, _NAMES, _NAMES, hard=st.booleans())
)


@settings(max_examples=200)
@given(layers=st.lists(st.lists(_ENTRIES, max_size=6), min_size=1, max_size=3))
def test_no_layers_change_what_is_outside(layers: list[list[Entry]], tmp_path_factory: pytest.TempPathFactory) -> None:
    top = tmp_path_factory.mktemp("top")
    (top / "outside/a").mkdir(parents=True)
    (top / "outside/l").write_text("kept")
    with contextlib.suppress(BundleRefused):  # a refusal is an answer, too
        _applied(top / "root", *(layer(*entries) for entries in layers))
    left = sorted(str(path.relative_to(top)) for path in top.rglob("*") if not path.is_relative_to(top / "root"))
    assert left == ["outside", "outside/a", "outside/l"]
    assert (top / "outside/l").read_text() == "kept"
    assert (top / "outside/l").stat().st_nlink == 1
    shutil.rmtree(top)


def test_devices_are_left_out_and_no_file_gives_rights(tmp_path: Path) -> None:
    entries = (device("dev/sda"), file("su", b"x", 0o6755), file("open", b"x", 0o777), file("closed", b"x", 0o000))
    _applied(tmp_path / "root", layer(*entries))
    assert list((tmp_path / "root/dev").iterdir()) == []
    modes = {path.name: oct(stat.S_IMODE(path.stat().st_mode)) for path in (tmp_path / "root").iterdir()}
    assert modes == {"su": "0o755", "open": "0o755", "closed": "0o644", "dev": "0o755"}


def test_a_layer_is_compared_with_its_digest_before_anything_is_written(tmp_path: Path) -> None:
    (tmp_path / "root").mkdir()
    with pytest.raises(BundleRefused, match="it was changed: save or fetch the image again"):
        apply_layer(io.BytesIO(layer(file("x"))), tmp_path / "root", "sha256:" + "0" * 64, 1 << 20)
    assert list((tmp_path / "root").iterdir()) == []


@pytest.mark.parametrize(
    ("body", "why"),
    [
        (gzip.compress(b"\0" * (2 << 20), mtime=0), "once it is unpacked"),
        (gzip.compress(layer(file("x")), mtime=0)[:-9], "a layer is damaged"),
    ],
    ids=["bomb", "cut off"],  # each process that collects names them alike
)
def test_a_layer_that_cannot_be_read_is_refused(body: bytes, why: str, tmp_path: Path) -> None:
    with pytest.raises(BundleRefused, match=why):
        apply_layer(io.BytesIO(body), tmp_path, "", 1 << 20)


def test_a_sparse_file_is_refused_and_not_left_out(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as tar:
        member = tarfile.TarInfo("app/data")
        member.pax_headers = {"GNU.sparse.map": "0,1", "GNU.sparse.size": str(1 << 50)}
        tar.addfile(member)
    with pytest.raises(BundleRefused, match="'app/data', a sparse file"):
        _applied(tmp_path / "root", buffer.getvalue())


def test_what_headers_say_is_not_kept(tmp_path: Path) -> None:
    """The attack: comments of each of many files, which gzip packs well, are more than memory holds."""
    body = commented(1000, 20_000)
    tracemalloc.start()
    try:
        apply_layer(io.BytesIO(body), tmp_path, "", len(body))
        assert tracemalloc.get_traced_memory()[1] < len(body) / 2
    finally:
        tracemalloc.stop()


def test_links_in_a_circle_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(BundleRefused, match="links that lead to links"):
        inside(tmp_path, "a/x")


def test_an_image_without_what_is_named_is_refused(tmp_path: Path) -> None:
    _applied(tmp_path, layer(file("usr/bin/here"), file("app/run", mode=0o644), link("bin", "usr/bin")))
    assert missing_program(tmp_path, _IMAGE, ["here", "x"]) == missing_program(tmp_path, _IMAGE, ["/bin/here"]) == ""
    for words in (["nowhere"], ["/app/run"], ["../../../../bin/true"]):
        assert missing_program(tmp_path, _IMAGE, words).startswith(f"the image has no program {words[0]!r}")
    assert "says nothing of what is run" in missing_program(tmp_path, _IMAGE, [])


def test_what_runs_in_an_image_sees_it_alone_and_writes_to_its_home_alone(tmp_path: Path) -> None:
    busybox, bubblewrap = _needed("busybox", "busybox-static"), _needed("bwrap", "bubblewrap")
    assert bubblewrap
    root, home = tmp_path / "root", tmp_path / "home"
    home.mkdir()
    _applied(root, layer(file("bin/sh", b""), file("app/data", b"of the image")))
    shutil.copyfile(busybox, root / "bin/sh")
    image = _IMAGE.model_copy(
        update={"folder": "/app", "user": 1234, "group": 77, "environment": {"A": "image", "B": "image"}}
    )
    script = f"cat data; echo; echo $A $B; id -u; id -g; ls /; echo x > {home}/y; echo x > /app/z; ls {Path.home()}"
    words = ["/bin/sh", "-c", 'for w in cat id ls; do alias $w="/bin/sh $w"; done; ' + script]
    command = image_command(root, image, words, {"B": "own"}, home)
    done = subprocess.run(command, capture_output=True, text=True, env={}, check=False, timeout=60)
    assert done.stdout.splitlines()[1:4] == ["image own", "1234", "77"], done
    assert (home / "y").read_text() == "x\n"
    assert not (root / "app/z").exists()
    assert "Read-only file system" in done.stderr


def test_what_runs_on_a_robot_of_root_sets_nothing_of_its_kernel(tmp_path: Path) -> None:
    busybox, _ = _needed("busybox", "busybox-static"), _needed("bwrap", "bubblewrap")
    (tmp_path / "home").mkdir()
    _applied(tmp_path / "root", layer(file("bin/sh")))
    shutil.copyfile(busybox, tmp_path / "root/bin/sh")
    script = "[ -e /proc/sys/kernel/core_pattern ] && echo there; (: >> /proc/sys/kernel/core_pattern) || echo closed"
    command = image_command(tmp_path / "root", _IMAGE, ["/bin/sh", "-c", script], {}, tmp_path / "home", on_robot=True)
    done = subprocess.run(command, capture_output=True, text=True, env={}, check=False, timeout=60)
    assert done.stdout == "there\nclosed\n", done


def _needed(program: str, package: str) -> str:
    found = shutil.which(program)
    if found is None:
        if os.environ.get("CI"):
            pytest.fail(f"apt-get install {package}")
        pytest.skip(f"apt-get install {package}")
    return found


def test_of_two_that_unpack_the_same_the_second_waits_and_keeps_what_the_first_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else it might look while what lies there is changed, and put away what the first has made since."""

    def look(target: Path) -> Path | None:
        descriptor = os.open(tmp_path, os.O_RDONLY)
        try:
            with pytest.raises(BlockingIOError):
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        finally:
            os.close(descriptor)
        return sealed_tree(target)

    monkeypatch.setattr(image_files, "sealed_tree", look)
    image = tmp_path / "image"
    with new_tree(image, ".unpack-") as second:
        with new_tree(image, ".unpack-"):
            pass
        made = image.stat().st_ino
        (second / "more").touch()
    assert (image.stat().st_ino, list(tmp_path.iterdir())) == (made, [image])
    (image / "files/more").touch()
    with new_tree(image, ".unpack-"):
        pass
    assert sealed_tree(image) == image / "files"
