"""Which tests run in one process of `pytest --numprocesses`, and which of them begin first."""

from collections.abc import Collection, Sequence

import pytest
from xdist.scheduler import LoadGroupScheduling
from xdist.workermanage import WorkerController

# What tests of a session share, which takes long to make: whoever asks for one runs where it is. Most of them ask for a
# Prefect server, too, which starts in seconds: a process with all of its tests would be the last to end.
_SERVERS = ("small_run", "team", "attack_cache", "prefect_server")
# Few tests a file, of many seconds each.
_LONG = ("tests/attacks/", "tests/deploy/promises/", "tests/integration/")
_LONG_GROUP = "long"


def group_items(items: Sequence[pytest.Item]) -> None:
    """Marks the tests that ask for a shared server, so that those of one server stay in one process, and long ones.

    Their files begin first: of other marks, who hands tests out knows nothing.

    Args:
        items: The tests that were collected.
    """
    for item in items:
        asked = getattr(item, "fixturenames", ())
        server = next((each for each in _SERVERS if each in asked), None)
        if server is not None:
            item.add_marker(pytest.mark.xdist_group(server))
        elif item.get_closest_marker("long") is not None:
            item.add_marker(pytest.mark.xdist_group(_LONG_GROUP))


def unit(test: str) -> str:
    """Returns the unit that a test is handed out with: its file, or the server that it shares with others.

    Args:
        test: Its node id, which xdist ends with ``@<group>`` for those of a group.
    """
    name, at, group = test.rpartition("@")
    return group if at and group in _SERVERS else (name + at + group).split("::", maxsplit=1)[0]


def weight(unit: str, tests: Collection[str]) -> tuple[bool, bool, int, int]:
    """Returns what units are handed out by, the largest first: what lasts long, then what has many tests.

    Short ones at the end let all processes end at about the same time (longest processing time first; Graham 1969, SIAM
    Journal on Applied Mathematics 17:416).
    """
    long = sum(each.endswith(f"@{_LONG_GROUP}") for each in tests)
    return unit in _SERVERS, unit.startswith(_LONG), long, len(tests)


class FileScheduling(LoadGroupScheduling):
    """Hands out the tests of a file together, so that what they share is made once."""

    def _split_scope(self, nodeid: str) -> str:
        return unit(nodeid)

    def _assign_work_unit(self, node: WorkerController) -> None:
        heaviest = max(self.workqueue, key=lambda each: weight(each, self.workqueue[each]))
        self.workqueue.move_to_end(heaviest, last=False)
        super()._assign_work_unit(node)
