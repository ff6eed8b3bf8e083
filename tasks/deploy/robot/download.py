"""A download that continues after it was cut by the network, the store, a kill or a loss of power.

The bytes that have arrived stay in the robot's folder, and the next attempt continues from them. The digest at the end
says whether the file is whole. If it is not, the file is removed and downloaded once more from its beginning.
"""

import errno
import shutil
from collections.abc import Callable
from pathlib import Path

from specs.errors import ObjectTooBig, StoreDamaged, StoreFull, StoreUnreachable
from tasks.storage.archives import LIMITS, digest_of
from tasks.storage.base.atomic_file import make_folder
from tasks.storage.base.store import Store

MOST_BYTES = LIMITS.total_bytes + (256 << 20)  # of an archive: what it may hold, and headers
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


def download(
    store: Store,
    key: str,
    target: Path,
    digest: str,
    *,
    most_bytes: int | None = None,
    on_block: Callable[[int, int], None] = lambda _done, _size: None,
) -> None:
    """Makes the file hold an object, going on from the bytes that it holds already.

    Args:
        store: Where the object is.
        key: Of the object.
        target: The file.
        digest: The SHA-256 that the object must have.
        most_bytes: More are never written; None for the most that a bundle may have.
        on_block: Called with the bytes that are there and the object's size, for every block.

    Raises:
        ObjectNotFound: There is no object.
        ObjectTooBig: It is bigger than it may be; nothing is left of it here.
        StoreDamaged: It is not the one with the digest; nothing is left of it here.
        StoreFull: This machine has no room; nothing is left of it here.
        StoreError: It was cut; what has arrived is left for the next time.
    """
    most = MOST_BYTES if most_bytes is None else most_bytes
    make_folder(target.parent)
    while True:
        size = store.size(key)
        if size > most:
            raise _too_big(target, f"{store.url}: {key} has {size} bytes", most)
        first = _size(target)
        _receive(store, key, target, size, on_block)
        if digest_of(target) == digest:
            return
        target.unlink()
        if first == 0:
            raise StoreDamaged(f"{store.url}: {key} is not the one with digest {digest}")


def _size(target: Path) -> int:
    return target.stat().st_size if target.exists() else 0


def _receive(store: Store, key: str, target: Path, size: int, on_block: Callable[[int, int], None]) -> None:
    # Unpacked it takes the same again. A disk that is filled to the brim would end what runs on it.
    done = _size(target)
    needed, free = 2 * size - done, shutil.disk_usage(target.parent).free
    if needed > free:
        raise _full(target, f"{needed >> 20} MiB are needed, {free >> 20} MiB are free")
    try:
        with target.open("ab") as file:
            for block in store.blocks(key, done):
                done += len(block)
                if done > size:
                    raise _too_big(target, f"{store.url}: {key} goes on", size)
                file.write(block)
                file.flush()
                on_block(done, size)
    except OSError as exc:
        if exc.errno in _NO_ROOM:
            raise _full(target, str(exc.strerror)) from exc
        raise
    if done < size:
        raise StoreUnreachable(f"{store.url}: {key} ended after {done} of {size} bytes")


def _too_big(target: Path, what: str, most: int) -> ObjectTooBig:
    target.unlink(missing_ok=True)
    return ObjectTooBig(f"{what}, more than the {most} that it may have")


def _full(target: Path, why: str) -> StoreFull:
    target.unlink(missing_ok=True)
    return StoreFull(f"no room for the bundle in {target.parent}: {why}")
