"""What a batch's end imports is imported while its episodes are driven."""

import sys
from threading import enumerate as all_threads

import pytest

from flows.stage import batch_stage

NOBODYS = "plistlib"  # of the standard library, and imported by nobody here


def test_modules_are_imported_and_those_that_are_missing_left_to_who_needs_them(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delitem(sys.modules, NOBODYS, raising=False)
    monkeypatch.setattr(batch_stage, "_NEEDED_AT_THE_END", ("no_such_module", NOBODYS))

    batch_stage._import_ahead()  # pyright: ignore[reportPrivateUsage]

    for thread in all_threads():
        if thread.name == "simyard imports":
            thread.join()
    assert NOBODYS in sys.modules
