"""Imports without the garbage collector."""

import gc
from collections.abc import Generator

import pytest

from tasks.server.watchdog import pause_collector


@pytest.fixture(autouse=True)
def _thaw() -> Generator[None, None, None]:  # pyright: ignore[reportUnusedFunction] - used by every test
    """Lets this process collect at its end what other tests have made."""
    yield
    gc.unfreeze()


def test_nothing_is_collected_in_a_pause_and_what_was_made_is_not_looked_at_again():
    with pause_collector():
        assert not gc.isenabled()
        made: list[object] = []
        made.append(made)
    assert gc.isenabled()
    assert not any(kept is made for kept in gc.get_objects())  # which leaves out what is frozen


def test_a_pause_ends_when_an_import_fails():
    with pytest.raises(ModuleNotFoundError), pause_collector():
        import_nothing()
    assert gc.isenabled()


def test_a_process_without_a_collector_keeps_none():
    gc.disable()
    try:
        with pause_collector():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def import_nothing() -> None:
    """Fails as the import of a module that is not installed."""
    raise ModuleNotFoundError("nothing")
