"""Which tests run in one process of `pytest --numprocesses`."""

from xdist.scheduler import LoadScopeScheduling

# Their tests share a Prefect server and a run on it (`tests/servers/prefect.py`), which take long to start.
_ONE_SERVER = ("tests/docs/", "tests/integration/")


def unit(test: str) -> str:
    """Returns the unit that a test is handed out with: its file, or all files that share a server."""
    file = test.split("::", maxsplit=1)[0]
    return "Prefect" if file.startswith(_ONE_SERVER) else file


class FileScheduling(LoadScopeScheduling):
    """Hands out the tests of a file together, so that what they share is made once."""

    def _split_scope(self, nodeid: str) -> str:
        return unit(nodeid)
