"""A container image's files: its blobs are read, its layers unpacked into a folder, and programs are run in that.

Layers are unpacked once, by the image's digest (OCI image specification 1.0, "Image Layer Filesystem Changeset"):

images/<digest>/files    the image's files; those of equal content are one file, of ``image-files``, in all images
images/<digest>/seal     SHA-256 of their names, rights, lengths and times: compared before each use

A file that was changed is found by its time, and the image unpacked anew. Who sets a time back could write a seal as
well: nothing that runs in an image can, for which it is read-only. Programs are run by ``bwrap``, without a daemon.
"""

import fcntl
import gzip
import hashlib
import json
import os
import posixpath
import shutil
import stat
import tarfile
import tempfile
import zlib
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, NamedTuple, Self, cast
from uuid import uuid4

from pydantic import ValidationError

from specs.bundle_files import ContainerImage
from specs.errors import BundleRefused
from specs.launched_file import IMAGE_FILE
from tasks.storage.archives import digest_of, open_tar, read_tar
from tasks.storage.base.local_files import OF_THE_DISK, cache_folder, room_in
from tasks.storage.sealed_bundle import FILES_FOLDER

LAYOUT = "image"
"""The folder of a bundle that has the image's blobs, as an OCI image layout."""
BLOCK_BYTES = 1 << 20
_SMALL_BYTES = 4 << 20
_GZIP = b"\x1f\x8b"
# Of everything that the layers of an image hold; ROS with a desktop has 5 GB.
_UNPACKED_BYTES, _ENTRIES = 16 << 30, 1_000_000
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


class ImageBlobs(NamedTuple):
    """Files of an image, in a folder or an archive."""

    where: str
    names: frozenset[str]
    tar: tarfile.TarFile | None
    folder: Path

    @contextmanager
    def open(self, name: str) -> Generator[IO[bytes]]:
        """Opens one of them."""
        name = posixpath.normpath(name)
        if name not in self.names:
            raise BundleRefused(f"{self.where}: it lacks {name[:200]!r}")
        if self.tar is None:
            with (self.folder / name).open("rb") as file:
                yield file
            return
        member = self.tar.getmember(name)
        if member.issym():  # as docker save wrote a layer that is there twice
            with self.open(posixpath.join(posixpath.dirname(name), member.linkname)) as file:
                yield file
            return
        file = self.tar.extractfile(member)
        if file is None:
            raise BundleRefused(f"{self.where}: {name[:200]!r} is no file")
        yield file

    def small(self, name: str, digest: str = "") -> bytes:
        """Returns a small file; refuses one that is not what a digest stands for."""
        with self.open(name) as file:
            body = file.read(_SMALL_BYTES + 1)
        if len(body) > _SMALL_BYTES:
            raise BundleRefused(f"{self.where}: {name[:200]!r} has more than {_SMALL_BYTES} bytes")
        require_digest(self.where, hashlib.sha256(body).hexdigest(), digest)
        return body

    def blob(self, entry: Mapping[str, Any]) -> Any:  # noqa: ANN401 - whatever stands in it
        """Returns what the small blob says that a descriptor names."""
        return json.loads(self.small(blob_name(entry["digest"]), entry["digest"]))


@contextmanager
def opened_blobs(place: Path) -> Generator[ImageBlobs]:
    """Opens an archive or a folder; what an image's files say wrongly is a refusal."""
    try:
        if place.is_dir():
            names = (path.relative_to(place).as_posix() for path in place.rglob("*") if path.is_file())
            yield ImageBlobs(place.name, frozenset(names), None, place)
            return
        with open_tar(place) as tar:
            members = list(tar.headers())
            for member in members:
                member.name = posixpath.normpath(member.name)
            yield ImageBlobs(place.name, frozenset(each.name for each in members), tar.file, place)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError, tarfile.TarError) as exc:
        raise BundleRefused(f"{place.name}: no container image: {type(exc).__name__}: {str(exc)[:200]}") from exc


def require_digest(where: str, found: str, digest: str) -> None:
    """Refuses a blob that is not what a digest stands for; an empty one stands for any."""
    if digest and digest != f"sha256:{found}":
        why = f"a blob has digest sha256:{found}, and {digest[:80]} is named"
        raise BundleRefused(f"{where}: {why}: it was changed: save or fetch the image again")


def blob_name(digest: object) -> str:
    """Returns the name of a blob's file in a layout."""
    algorithm, _, number = str(digest).partition(":")
    if algorithm != "sha256" or len(number) != 64 or set(number) - set("0123456789abcdef"):
        raise BundleRefused(f"{str(digest)[:80]!r} is no SHA-256")
    return f"blobs/sha256/{number}"


def private_folder(folder: Path) -> None:
    """Makes a folder that nobody else may look into."""
    folder.mkdir(parents=True, exist_ok=True)
    if stat.S_IMODE(folder.stat().st_mode) != stat.S_IRWXU:
        folder.chmod(stat.S_IRWXU)


def read_image(bundle: Path) -> ContainerImage | None:
    """Returns what a bundle tells of its image; None for a bundle that is none.

    Raises:
        BundleRefused: What it tells is not what an image's bundle does.
    """
    try:
        return ContainerImage.model_validate_json((bundle / IMAGE_FILE).read_bytes()[:_SMALL_BYTES])
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
        return None
    except (ValidationError, ValueError) as exc:
        raise BundleRefused(f"{IMAGE_FILE}: {' '.join(str(exc).split())[:300]}") from exc


class ImageFolders(NamedTuple):
    """Where images are unpacked.

    Attributes:
        images: Folder of a folder for each.
        files: Folder of the files that images share.
    """

    images: Path
    files: Path

    @classmethod
    def of_cache(cls) -> Self:
        """Returns those of this machine's cache, which nobody else may look into."""
        found = cls(cache_folder() / "images", cache_folder() / "image-files")
        for folder in found:
            private_folder(folder)
        return found


def image_root(bundle: Path, folders: ImageFolders | None = None) -> Path | None:
    """Returns the folder with the files of a bundle's image, unpacked once; None for a bundle that is no image.

    Args:
        bundle: Its folder.
        folders: Where unpacked images lie; None for the cache.

    Raises:
        BundleRefused: The bundle's blobs are not those of the image that it names, or cannot be unpacked.
    """
    image = read_image(bundle)
    return unpacked(bundle, image.digest, folders or ImageFolders.of_cache()) if image else None


def image_place(bundle: Path) -> Path | None:
    """Returns where `image_root` has unpacked a bundle's image, for a process whose parent has compared it."""
    image = read_image(bundle)
    return cache_folder() / "images" / image.digest / FILES_FOLDER if image else None


def unpacked(bundle: Path, digest: str, folders: ImageFolders) -> Path:
    """Returns the folder of an image's files: there whole or not at all, each layer compared with its digest."""
    target = folders.images / digest
    if root := sealed_tree(target):
        return root
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)
    with turn_at(target):
        return sealed_tree(target) or _unpack(bundle, digest, target, folders.files)


def _unpack(bundle: Path, digest: str, target: Path, shared: Path) -> Path:
    with new_tree(target, ".unpack-") as root, opened_blobs(bundle / LAYOUT) as blobs:
        manifest, left = blobs.blob({"digest": f"sha256:{digest}"}), _UNPACKED_BYTES
        diff_ids = blobs.blob(manifest["config"])["rootfs"]["diff_ids"]
        for each, diff_id in zip(manifest["layers"], diff_ids, strict=True):
            with blobs.open(blob_name(each["digest"])) as file:
                left -= apply_layer(file, root, str(diff_id), left, shared)
        _name_hosts(root)
        os.sync()  # its name stands for whole files, also after the power fails
    return target / FILES_FOLDER


_SEAL = "seal"


@contextmanager
def turn_at(target: Path) -> Generator[None]:
    """Lets one thread of one process at a time make what is to lie somewhere: the next one finds it made."""
    path = target.with_name(f".turn-{target.name}")
    with room_in(target.parent):
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        path.unlink(missing_ok=True)  # who waits goes on with the file that it has, who comes later makes another
        os.close(descriptor)


@contextmanager
def new_tree(target: Path, mark: str) -> Generator[Path]:
    """Makes a folder of files in the ``with`` block, and then seals it: it is there whole or not at all.

    Args:
        target: Where it is to lie; what lies there and is not what its seal says is put away.
        mark: How the names of half-made ones begin.
    """
    home = target.parent
    with room_in(home), tempfile.TemporaryDirectory(prefix=mark, dir=home, ignore_cleanup_errors=True) as folder:
        made = Path(folder) / "made"
        (made / FILES_FOLDER).mkdir(parents=True)
        yield made / FILES_FOLDER
        (made / _SEAL).write_text(_seal(made / FILES_FOLDER))
        _settle(made, target)


def _settle(made: Path, target: Path) -> None:
    """Gives a folder that is whole its name, unless another process was first."""
    descriptor = os.open(target.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)  # or one puts away what the other has just made
        if sealed_tree(target):
            return
        with suppress(FileNotFoundError):  # else it was changed
            target.rename(made.with_name("changed"))
        made.rename(target)
    finally:
        os.close(descriptor)


def sealed_tree(target: Path) -> Path | None:
    """Returns the folder of files that `new_tree` made; None if it is not there, or was changed."""
    try:
        intact = (target / _SEAL).read_text() == _seal(target / FILES_FOLDER)
    except (OSError, ValueError):
        return None
    return target / FILES_FOLDER if intact else None


def _seal(top: Path) -> str:
    """Returns what a folder is known by that holds the same files as when it was made; nothing in them is read."""
    found, left = hashlib.sha256(), [str(top)]
    while left:
        path = left.pop()
        state = os.lstat(path)
        if stat.S_ISDIR(state.st_mode):
            with os.scandir(path) as entries:
                left += sorted(each.path for each in entries)
            told = ""
        elif stat.S_ISLNK(state.st_mode):
            told = f"-> {os.readlink(path)}"  # noqa: PTH115 - of thousands of files
        else:
            told = f"{state.st_mode:o} {state.st_size} {state.st_mtime_ns}"
        found.update(os.fsencode(f"{path[len(str(top)) :]}\0{told}\0"))
    return found.hexdigest()


def _name_hosts(root: Path) -> None:
    """Writes what every container is given: who ``localhost`` is, and where a robot's own files of names go."""
    folder = inside(root, "etc")
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in _NAMES.items():
        _remove(folder / name)
        (folder / name).write_text(text)


_HIDES, _HIDES_ALL, _HIDES_NOTHING = ".wh.", ".wh..wh..opq", ".wh..wh."
_LINKS = 40
_LAST_S = 0xFFFFFFFF


def apply_layer(file: IO[bytes], root: Path, diff_id: str, most_bytes: int, shared: Path | None = None) -> int:
    """Applies a layer to the folder of an image, and returns how many bytes it has unpacked.

    Nothing is written outside the folder, whatever names and links the layer and those below it have: each part of a
    name is looked at, and a link leads where it would inside the image. Files belong to this account, and give no
    rights that it does not have; devices are left out, as ``/dev`` is another one.

    Args:
        file: The layer, a plain tar or one that gzip has packed; open at its beginning.
        root: The folder, which nobody else writes to.
        diff_id: The digest that the tar must have.
        most_bytes: How long it may be.
        shared: Folder of the files that images share; None for none.

    Raises:
        BundleRefused: It is changed, is packed by something else, is too long, or leads out of the image.
    """
    head = file.read(len(_GZIP))
    file.seek(0)
    tar: IO[bytes] = cast("IO[bytes]", gzip.GzipFile(fileobj=file)) if head == _GZIP else file
    size = _require_layer(tar, diff_id, most_bytes)
    tar.seek(0)
    own = set[Path]()
    with read_tar(cast("gzip.GzipFile", tar)) as layer:
        for number, member in enumerate(layer.headers()):
            if number >= _ENTRIES:
                raise BundleRefused(f"a layer with more than {_ENTRIES:,} files")
            # Else it keeps them, with all that their headers say.
            layer.file.members = []  # pyright: ignore[reportAttributeAccessIssue]
            try:
                _apply(layer.file, member, root, own, shared)
            except (OSError, ValueError) as exc:  # such as a file's name that is a folder's as well
                if isinstance(exc, OSError) and exc.errno in OF_THE_DISK:
                    raise
                raise BundleRefused(f"{member.name[:200]!r} in a layer cannot be unpacked: {exc}") from exc
    return size


def _require_layer(tar: IO[bytes], diff_id: str, most_bytes: int) -> int:
    """Returns how long a layer is once it is unpacked; it is read for that, before anything of it is written."""
    found, size = hashlib.sha256(), 0
    try:
        while block := tar.read(BLOCK_BYTES):
            size += len(block)
            if size > most_bytes:
                raise BundleRefused(f"more than {_UNPACKED_BYTES >> 30} GB once it is unpacked")
            found.update(block)
    except (EOFError, gzip.BadGzipFile, zlib.error) as exc:
        raise BundleRefused(f"a layer is damaged: {exc}") from exc
    require_digest("a layer", found.hexdigest(), diff_id)
    return size


def _apply(tar: tarfile.TarFile, member: tarfile.TarInfo, root: Path, own: set[Path], shared: Path | None) -> None:
    """Applies an entry of a layer; ``own`` are the paths that this layer made, which it does not hide itself."""
    parts = [part for part in member.name.split("/") if part not in ("", ".")]
    if ".." in parts:
        raise BundleRefused(f"{member.name[:200]!r} in a layer leads out of the image")
    if not parts:
        return
    folder = inside(root, "/".join(parts[:-1]))
    folder.mkdir(mode=0o755, parents=True, exist_ok=True)
    name, path = parts[-1], folder / parts[-1]
    if name == _HIDES_ALL:
        for each in [each for each in folder.iterdir() if each not in own]:
            _remove(each)
    elif name.startswith(_HIDES):
        hidden = name.removeprefix(_HIDES)
        if not name.startswith(_HIDES_NOTHING) and hidden not in ("", ".", "..") and folder / hidden not in own:
            _remove(folder / hidden)
    else:
        _place(tar, member, path, root)
        if shared and member.isreg():
            merge_file(path, shared)
        while path not in own and path != root:
            own.add(path)
            path = path.parent


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _place(tar: tarfile.TarFile, member: tarfile.TarInfo, path: Path, root: Path) -> None:
    """Makes a file, folder or link, in place of what was there; a folder stays, with what is in it."""
    if not (member.isdir() and path.is_dir() and not path.is_symlink()):
        _remove(path)
    if member.isdir():
        path.mkdir(mode=0o755, exist_ok=True)
    elif member.issym():
        path.symlink_to(member.linkname)
    elif member.islnk():
        folder, _, name = member.linkname.rstrip("/").rpartition("/")
        first = inside(root, folder) / name
        if name in ("", ".", "..") or first.is_symlink() or not first.is_file():
            raise BundleRefused(
                f"a layer has {member.name[:200]!r}, a link to {member.linkname[:200]!r}: no file of it"
            )
        os.link(first, path)
    elif member.issparse():  # it may say that it is longer than any disk
        raise BundleRefused(f"a layer has {member.name[:200]!r}, a sparse file: pack it without --sparse")
    elif member.isreg():
        body = tar.extractfile(member)
        with path.open("xb") as sink:
            shutil.copyfileobj(body, sink, BLOCK_BYTES) if body else None
        path.chmod(0o755 if member.mode & 0o111 else 0o644)
        # Python compiles a module anew that is not as old as its compiled one says.
        time_s = int(min(max(member.mtime, 0), _LAST_S))
        os.utime(path, (time_s, time_s))


def merge_file(path: Path, shared: Path) -> None:
    """Makes a file one with that of another image that has its content, rights and time.

    Args:
        path: The file.
        shared: Folder of the files that images share.
    """
    state, digest = path.lstat(), digest_of(path)
    known, spare = shared / f"{digest}-{state.st_mode:o}-{state.st_mtime_ns}", path.with_name(f".{uuid4().hex}")
    with suppress(OSError):  # it spares room, and no more: a disk may have no links, or no more of this file
        if _is_still(known, state, digest):
            os.link(known, spare)
            spare.replace(path)
        else:
            known.unlink(missing_ok=True)
            os.link(path, known)


def _is_still(known: Path, state: os.stat_result, digest: str) -> bool:
    """Returns whether a shared file is what its name says."""
    try:
        found = known.lstat()
        same = (found.st_mode, found.st_mtime_ns) == (state.st_mode, state.st_mtime_ns)
        return same and digest_of(known) == digest
    except OSError:
        return False


def inside(root: Path, name: str) -> Path:
    """Returns where a name of an image's lies: links are followed as they are in it, and none leads out of it.

    Raises:
        BundleRefused: Too many links.
    """
    path, links, left = root, 0, list(reversed(name.split("/")))
    while left:
        part = left.pop()
        if part in ("", "."):
            continue
        if part == "..":
            path = path if path == root else path.parent
            continue
        path = path / part
        if path.is_symlink():
            links += 1
            if links > _LINKS:
                raise BundleRefused(f"{name[:200]!r}: links that lead to links, more than {_LINKS}")
            target = str(path.readlink())
            path = root if target.startswith("/") else path.parent
            left += reversed(target.split("/"))
    return path


# Of the image; the programs get others.
HOME_ON_ROBOT = "/simyard-home"
_DEVICES = (("--dev", "/dev"), ("--dev-bind", "/dev", "/dev"))
_NO_ROS = "the image has no ROS: neither /opt/ros, nor roslaunch, nor rclpy: install it there, as ros:noetic has it"
_NAMES = {"hosts": "127.0.0.1\tlocalhost\n", "resolv.conf": ""}
_MOUNTED = frozenset({"proc", "dev", "tmp", "run", "sys"})


def image_command(
    root: Path,
    image: ContainerImage,
    words: Sequence[str],
    variables: Mapping[str, str],
    home: Path,
    *,
    on_robot: bool = False,
) -> tuple[str, ...]:
    """Returns the command that runs words in an image: it is read-only, and has a home folder, and no rights.

    Who may see which processes, and which network, is as outside: the caller has put up walls before.

    Args:
        root: Where it is unpacked.
        image: What it says of itself.
        words: What is run.
        variables: That it has beside the image's own.
        home: A folder that it may write to.
        on_robot: Whether it has this machine's devices, and its home is called `HOME_ON_ROBOT`; else another ``/dev``,
            and its home is called as outside.

    Raises:
        BundleRefused: bubblewrap is not installed, or the image does not have what is run.
    """
    bubblewrap = shutil.which("bwrap")
    if bubblewrap is None:
        raise BundleRefused("container images need bubblewrap, which is not installed: apt-get install bubblewrap")
    if why := missing_program(root, image, words):
        raise BundleRefused(why)
    command = [bubblewrap, "--unshare-user", "--uid", str(image.user), "--gid", str(image.group), "--cap-drop", "ALL"]
    # On a robot a signal to the group ends bubblewrap at once, and the program shall end as it likes; the agent looks.
    command += [*([] if on_robot else ["--die-with-parent"]), "--tmpfs", "/"]
    for path in sorted(each for each in root.iterdir() if each.name not in _MOUNTED):
        if path.is_symlink():
            command += ["--symlink", str(path.readlink()), f"/{path.name}"]
        else:
            command += ["--ro-bind", str(path), f"/{path.name}"]
    # In an agent's of root, whoever is of that account could write what the kernel runs as root.
    command += ["--ro-bind" if on_robot else "--bind", "/proc", "/proc"]
    command += [*_DEVICES[on_robot], "--tmpfs", "/tmp", "--tmpfs", "/run"]  # noqa: S108 - new ones
    for name in _NAMES if on_robot else ():
        command += ["--ro-bind-try", f"/etc/{name}", f"/etc/{name}"]
    command += ["--bind", str(home), HOME_ON_ROBOT if on_robot else str(home), "--remount-ro", "/"]
    command += ["--chdir", image.folder]
    for name, value in {"PATH": _PATH, **image.environment, **variables}.items():
        command += ["--setenv", name, value]
    return (*command, "--", *words)


def missing_program(root: Path, image: ContainerImage, words: Sequence[str], *, ros: bool = False) -> str:
    """Returns why an image cannot run some words: it does not have the program that they begin with; empty if it can.

    What its entry point makes of the rest, nobody knows who has not run it; a path in it has to be there. To drive a
    robot in a simulation, it has to have ROS as well.
    """
    if not words:
        return "the image says nothing of what is run: write launchConfig.command"
    told = image.environment.get("PATH") or _PATH
    paths = [*told.split(":"), *(f"/{each.relative_to(root)}" for each in root.glob("opt/ros/*/bin"))]
    for word in dict.fromkeys((words[0], *words[len(image.entrypoint) :][:1])):
        places = [posixpath.join(image.folder, word)] if "/" in word else [f"{each}/{word}" for each in paths]
        if not any((found := inside(root, place)).is_file() and os.access(found, os.X_OK) for place in places):
            return f"the image has no program {word!r}: launchConfig.command, or packageName and launchFile, names it"
    return _NO_ROS if ros and not image.ros else ""
