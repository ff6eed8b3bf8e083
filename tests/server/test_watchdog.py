"""A run whose server went away is ended, and imports are not looked through for garbage."""

import gc
import threading
from types import SimpleNamespace

import pytest

from specs.errors import StageFailed
from tasks.server import watchdog
from tasks.server.watchdog import WatchdogPace, WatchdogState, guard_run, pause_collector


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


_AT_ONCE = WatchdogPace(look_s=0.01, patience_s=0.0, grace_s=30.0)


def _must_not(failure: StageFailed) -> None:
    pytest.fail(f"given up: {failure}")


def test_a_block_is_interrupted_when_its_server_is_gone():
    inside = threading.Event()  # an interrupt before that would not come to the block

    def waits() -> None:
        inside.set()
        threading.Event().wait(250)

    with (
        pytest.raises(StageFailed, match="it went away"),
        guard_run(lambda: not inside.is_set(), "it went away", _must_not, _AT_ONCE) as watch,
    ):
        waits()
    assert watch.gone.is_set()


def test_a_block_that_goes_on_in_spite_of_the_interrupt_is_given_up():
    given_up, inside = threading.Event(), threading.Event()
    told: list[str] = []

    def give_up(failure: StageFailed) -> None:
        told.append(str(failure))
        given_up.set()

    def goes_on() -> None:
        try:
            inside.set()
            threading.Event().wait(250)
        except KeyboardInterrupt:
            assert given_up.wait(250)

    pace = WatchdogPace(look_s=0.01, patience_s=0.0, grace_s=0.05)
    # The server goes when the block is where it catches: an interrupt before that ends it.
    with guard_run(lambda: not inside.is_set(), "it went away", give_up, pace):
        goes_on()
    assert told == ["InternalServiceError: it went away"]


def test_a_block_whose_server_stays_is_left_alone():
    looks = threading.Semaphore(0)

    def is_there() -> bool:
        looks.release()
        return True

    with guard_run(is_there, "", _must_not, _AT_ONCE) as watch:
        assert all(looks.acquire() for _ in range(3))
    assert not watch.gone.is_set()


def test_a_server_that_comes_back_in_time_counts_as_there(monkeypatch: pytest.MonkeyPatch):
    clock_s = iter(range(0, 100, 10))
    monkeypatch.setattr(watchdog, "time", SimpleNamespace(monotonic=lambda: next(clock_s)))
    answers = [False, False, True, False, False]

    def is_there() -> bool:
        if len(answers) == 1:
            watch.left.set()
        return answers.pop(0)

    watch = WatchdogState(is_there)
    assert not watchdog._is_lost(watch, WatchdogPace(look_s=0.0, patience_s=15.0))


def test_a_server_that_is_away_for_too_long_is_lost(monkeypatch: pytest.MonkeyPatch):
    clock_s = iter([0, 10, 20])
    monkeypatch.setattr(watchdog, "time", SimpleNamespace(monotonic=lambda: next(clock_s)))
    assert watchdog._is_lost(WatchdogState(is_there=lambda: False), WatchdogPace(look_s=0.0, patience_s=15.0))
    assert list(clock_s) == []


def test_an_error_of_the_client_is_told_as_what_it_is():
    patient = WatchdogPace(look_s=60.0)
    with pytest.raises(StageFailed, match="it went away"), guard_run(lambda: False, "it went away", _must_not, patient):
        raise ConnectionError("all attempts failed")
    with pytest.raises(ConnectionError), guard_run(lambda: True, "it went away", _must_not, patient):
        raise ConnectionError("another server's")


def test_an_error_that_simyard_can_explain_stays():
    with (
        pytest.raises(StageFailed, match="disk"),
        guard_run(lambda: False, "it went away", _must_not, WatchdogPace(look_s=60.0)),
    ):
        raise StageFailed("AccessDenied", "disk")
