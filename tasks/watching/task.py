"""Progress in Prefect: a bar that moves at most once a second, and in the terminal through the listener."""

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import cast
from uuid import UUID

from prefect.artifacts import create_progress_artifact, update_progress_artifact

from tasks.watching.listening import tell

Progress = Callable[[int, int], None]
# `--watch` prints every update, and each is a request to the server.
_INTERVAL_S = 1.0


@contextmanager
def watched(stage: str, key: str) -> Generator[Progress, None, None]:
    """Yields a function that tells the terminal and Prefect how far a stage is.

    Args:
        stage: What a person calls it, such as ``Worlds``.
        key: The artifact's key: lower-case letters, digits and dashes.
    """
    artifact = cast("UUID", create_progress_artifact(progress=0.0, key=key, description=stage))
    last_s = time.monotonic()

    def progress(done: int, total: int) -> None:
        nonlocal last_s
        tell(stage, done, total)
        if time.monotonic() - last_s >= _INTERVAL_S:
            last_s = time.monotonic()
            update_progress_artifact(artifact, progress=100.0 * done / max(total, 1))

    yield progress
    update_progress_artifact(artifact, progress=100.0)
