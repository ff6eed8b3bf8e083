"""Stores for every test: a folder, and a bucket on a real S3 server that is started when first asked for."""

import atexit
import gc
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from uuid import uuid4

# For the processes of `--numprocesses` and for what tests start. Threads of a matrix product wait for each other by
# spinning: beside other processes they spin for as long as those run, and a product took twelve times its own time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook
from xdist.remote import Producer

from tasks.simulate.devices import prepare_devices
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.file_scheduler import FileScheduling, group_items
from tests.repository import ROOT
from tests.servers.seaweed import Seaweed, running_seaweed

# Before any test module imports JAX; after it, shapes are checked wherever the modules below are imported, by whichever
# test comes first.
prepare_devices()
CHECKED = [
    "application.robot_model",
    "engines.mjx.mjx_robot",
    "geometry",
    "lane.control_step",
    "sensors.lidar",
    "sensors.odometry",
]
install_import_hook([f"tasks.simulate.{module}" for module in CHECKED], "beartype.beartype")

# What a collection makes stays until the end: to look for waste among ten thousand tests, again and again, was a tenth
# of the tests' time.
gc.disable()
_OBJECTS_BETWEEN_LOOKS = 20_000

_BUCKET = "tests"
pytest_plugins = ["tests.servers.prefect", "tests.integration.prefect_features.team"]
# How long an example takes says how busy the machine is, not whether the code is right. The same commit is tried
# with the same examples, so that a red run is about the change; `make explore` looks for new ones.
settings.register_profile("simyard", deadline=None, derandomize=True, max_examples=40)
settings.register_profile("explore", deadline=None, max_examples=1000)
settings.load_profile(os.environ.get("SIMYARD_HYPOTHESIS", "simyard"))


@pytest.fixture(scope="session")
def seaweed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Seaweed]:
    """The S3 server of this test run, with one bucket."""
    with running_seaweed(tmp_path_factory.mktemp("seaweed")) as server:
        server.make_bucket(_BUCKET)
        yield server


@pytest.fixture
def s3_url(seaweed: Seaweed, monkeypatch: pytest.MonkeyPatch) -> Callable[[], str]:
    """Makes URLs of places where no store is yet; the environment lets this and child processes reach them."""
    for name, value in seaweed.environment().items():
        monkeypatch.setenv(name, value)
    return lambda: f"s3://{_BUCKET}/{uuid4().hex}"


@pytest.fixture
def file_store(tmp_path: Path) -> Store:
    """A new store in a folder."""
    return open_store((tmp_path / "store").as_uri())


@pytest.fixture
def s3_store(s3_url: Callable[[], str]) -> Store:
    """A new store in a bucket."""
    return open_store(s3_url())


@pytest.fixture
def store(file_store: Store) -> Store:
    """A new store; `tests/storage/contracts` says that a bucket is as good."""
    return file_store


# A shell lets what it starts in the background ignore interrupts, and so would each process that a test starts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def own_signal_handlers() -> Iterator[None]:
    """Puts handlers of signals back: a command that a test runs in its own process leaves those of the shell."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        if signal.getsignal(number) is not handler:
            signal.signal(number, handler)


# What starts a Prefect server or runs a whole document, and the promises of fleets: each has a quicker test elsewhere.
_LONG_FOLDERS = (ROOT / "tests/integration", ROOT / "tests/deploy/promises", ROOT / "tests/attacks")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leaves out what takes minutes, unless it is asked for by its marker; `make test` leaves out ``long`` as well."""
    long_files = {path for path in {item.path for item in items} if any(map(path.is_relative_to, _LONG_FOLDERS))}
    for item in items:
        if item.path in long_files:
            item.add_marker(pytest.mark.long)
    group_items(items)
    if "soak" in str(config.getoption("markexpr")):
        return
    long = [item for item in items if item.get_closest_marker("soak")]
    if long:
        config.hook.pytest_deselected(items=long)
        left_out = {id(item) for item in long}
        items[:] = [item for item in items if id(item) not in left_out]


def pytest_collection_finish() -> None:
    """Looks for waste from now on, but not among what is there."""
    gc.freeze()
    gc.set_threshold(_OBJECTS_BETWEEN_LOOKS)
    gc.enable()


# Some libraries complain of what is left of theirs. After pytest, which looks for waste twice when it ends.
atexit.register(gc.unfreeze)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> FileScheduling:
    """Keeps each file in one process, and all files that share a Prefect server; this process collects no tests."""
    gc.enable()
    return FileScheduling(config, log)
