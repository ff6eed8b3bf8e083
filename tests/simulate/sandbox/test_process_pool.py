"""Processes that simulate are used again, but never for bundles that are not what their digests say any more."""

import hashlib
import io
import os
import shutil
import tarfile
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from specs.data.episode import EpisodeResult
from specs.data.world import World
from specs.errors import BundleRefused
from tasks.progress.listener import listen_to_progress
from tasks.simulate.plan.chunks import plan_chunks
from tasks.simulate.sandbox import process_pool
from tasks.simulate.sandbox import simulator as simulator_module
from tasks.simulate.sandbox.process_pool import prepare_simulator, simulator
from tasks.simulate.sandbox.protocol import LanesWork, Rows, SentWorlds
from tasks.simulate.sandbox.sandbox_client import SandboxClient
from tasks.simulate.sandbox.simulator import Simulator
from tasks.storage.sealed_bundle import seal_bundle
from tests.factories.simulations import DRIFT, FOLDERS, pushing


class Idle:
    """A process that does nothing."""

    alive = True
    begun = 0

    def __init__(self, bundles: object) -> None:
        self.bundles = bundles
        Idle.begun += 1

    def end(self) -> None:
        self.alive = False


@pytest.fixture
def bundles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Path]:
    """A bundle of one file in a cache folder."""
    monkeypatch.setattr(process_pool, "Simulator", Idle)
    archive = tmp_path / "bundle.tar"
    with tarfile.open(archive, "w") as tar:
        header = tarfile.TarInfo("courier/drive.py")
        header.size, header.mode = 9, 0o644
        tar.addfile(header, io.BytesIO(b"SPEED = 1"))
    digest = hashlib.sha256(archive.read_bytes()).hexdigest()
    return {digest: seal_bundle(archive, tmp_path / digest, digest)}


def edit(files: Path) -> None:
    for path in (files / "courier", files / "courier/drive.py"):
        path.chmod(0o755)
    (files / "courier/drive.py").write_bytes(b"SPEED = 9")


def nobody() -> SimpleNamespace:
    """Returns a process that prints nothing, beyond all numbers of processes."""
    return SimpleNamespace(stdout=Path(os.devnull).open("rb"), pid=1 << 30, wait=lambda: 0)


def test_a_process_is_used_again_while_its_bundles_are_what_they_were(bundles: dict[str, Path]):
    with simulator(bundles) as first:
        pass
    with simulator(bundles) as second:
        assert second is first


def test_a_process_that_was_begun_before_its_batch_is_the_one_that_simulates(bundles: dict[str, Path]):
    before = Idle.begun
    prepare_simulator(bundles)
    assert Idle.begun == before + 1
    prepare_simulator(bundles)
    with simulator(bundles):
        assert Idle.begun == before + 1


def test_however_often_a_process_is_used_one_thread_waits_for_its_end(bundles: dict[str, Path]):
    others = set(threading.enumerate())
    for _ in range(20):
        with simulator(bundles):
            pass
    waiting = [each for each in threading.enumerate() if each not in others and isinstance(each, threading.Timer)]
    assert sum(not each.finished.is_set() for each in waiting) == 1
    process_pool._idle.end_all()
    assert all(each.finished.is_set() for each in waiting)


@pytest.mark.parametrize("used_before", [False, True])
def test_no_process_simulates_with_a_bundle_that_somebody_edited(bundles: dict[str, Path], *, used_before: bool):
    (files,) = bundles.values()
    if used_before:
        with simulator(bundles):
            pass
    edit(files)
    with pytest.raises(BundleRefused, match=r"is not the bundle .* any more; run it again"), simulator(bundles):
        pass


def test_a_chunk_is_sent_once_while_questions_name_it_and_again_if_it_has_other_episodes(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(simulator_module, "_started", lambda *_: nobody())
    process = Simulator({})
    first, second, third = plan_chunks([pushing(index, world="hand/pen-0") for index in range(6)], 2)
    assert process.new_chunks([first, second]) == (first, second)
    assert process.new_chunks([second, third]) == (third,)
    half = second.model_copy(update={"requests": second.requests[:1]})
    assert process.new_chunks([half]) == (half,)
    assert process.new_chunks([half, third]) == (third,)
    process.end()


@pytest.mark.parametrize("numbers", [(0,), (0, 1)])
def test_chunks_ahead_may_be_to_blame_for_an_answer_that_is_refused_when_it_is_read(
    monkeypatch: pytest.MonkeyPatch, numbers: tuple[int, ...]
):
    monkeypatch.setattr(simulator_module, "_started", lambda *_: nobody())
    monkeypatch.setattr(Simulator, "_asked", lambda *_: (Rows(), ()))
    process, worlds = Simulator({}), SentWorlds(new={})
    process.ask(LanesWork(numbers=numbers, new=(), worlds=worlds, bundles={}, lanes=8, engine="auto"))
    assert process.refused(ValueError("no rows")).beside_others == (len(numbers) > 1)
    assert process.broke_off("rows of others").beside_others == (len(numbers) > 1)


LANES = 8


@pytest.mark.long
def test_a_later_process_traces_nothing_until_the_bundle_changes(
    tmp_path: Path, pens: dict[str, World], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    requests = [pushing(k, world="hand/pen-0", seed=k) for k in range(LANES)]
    robot = requests[0].robot.digest
    for digest in (robot, DRIFT):
        shutil.copytree(FOLDERS[digest], tmp_path / digest)
    bundles = {digest: tmp_path / digest for digest in (robot, DRIFT)}
    scenario = tmp_path / DRIFT / "drift" / "endless.py"
    source = scenario.read_text().replace(
        "return jnp.zeros(())", 'print("it is traced", flush=True); return jnp.zeros(())'
    )
    scenario.write_text(source)
    (chunk,) = plan_chunks(requests, LANES)

    def run() -> tuple[list[EpisodeResult], int]:
        printed: list[str] = []
        compiled: list[tuple[int, int]] = []

        def listen(stage: str, done: int, total: int) -> None:
            compiled.extend([(done, total)] if stage == "Compilation" else [])

        with listen_to_progress(listen):
            rows = SandboxClient(bundles, LANES, "planar", lambda: False, printed=printed.append).simulate(chunk, pens)
        process_pool._idle.end_all()  # pyright: ignore[reportPrivateUsage]
        traces = "".join(printed).count("it is traced")
        # Whoever waits hears of what is compiled, before and after it, and of nothing that is loaded.
        assert compiled[:2] == ([(0, 1), (1, 1)] if traces else [])
        return rows.rows(), traces

    first, second = run(), run()
    assert first[1] > 0
    assert second == (first[0], 0)
    scenario.write_text(f"{source}\n# changed\n")
    assert run()[1] > 0
