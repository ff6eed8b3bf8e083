"""Which tests run in one process of `pytest --numprocesses`, and which of them begin first."""

from xdist.scheduler import LoadScopeScheduling
from xdist.workermanage import WorkerController

# Their tests share a Prefect server and a run on it (`tests/servers/prefect.py`), which take long to start.
_ONE_SERVER = ("tests/docs/", "tests/integration/")
_PREFECT = "Prefect"
# Few tests a file, of many seconds each.
_LONG = ("tests/attacks/", "tests/deploy/promises/")


def unit(test: str) -> str:
    """Returns the unit that a test is handed out with: its file, or all files that share a server."""
    file = test.split("::", maxsplit=1)[0]
    return _PREFECT if file.startswith(_ONE_SERVER) else file


def weight(unit: str, tests: int) -> tuple[bool, bool, int]:
    """Returns what units are handed out by, the largest first: what lasts long, then what has many tests.

    Short ones at the end let all processes end at about the same time (longest processing time first; Graham 1969, SIAM
    Journal on Applied Mathematics 17:416).
    """
    return unit == _PREFECT, unit.startswith(_LONG), tests


class FileScheduling(LoadScopeScheduling):
    """Hands out the tests of a file together, so that what they share is made once."""

    def _split_scope(self, nodeid: str) -> str:
        return unit(nodeid)

    def _assign_work_unit(self, node: WorkerController) -> None:
        heaviest = max(self.workqueue, key=lambda each: weight(each, len(self.workqueue[each])))
        self.workqueue.move_to_end(heaviest, last=False)
        super()._assign_work_unit(node)
