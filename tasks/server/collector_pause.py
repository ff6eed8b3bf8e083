"""Imports without Python's garbage collector, which looks through all that is imported already, again and again."""

import gc
from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def pause_collector() -> Generator[None, None, None]:
    """Makes no collection in the block, and none ever of what the block has made; for a process that imports once.

    Modules, classes and models stay until the process ends. A collection finds no garbage in them, and one of all of
    Prefect's takes a tenth of a second (docs/reference/prefect.md, section 2).
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if enabled:
            gc.enable()
