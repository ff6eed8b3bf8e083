"""Programs from one process that simulates to the next: the second one traces nothing, and has the same rows."""

import shutil
from pathlib import Path

import pytest

from specs.data.episode import EpisodeResult
from specs.data.world import World
from tasks.progress.listener import listen_to_progress
from tasks.simulate.plan.chunks import plan_chunks
from tasks.simulate.sandbox import process_pool
from tasks.simulate.sandbox.sandbox_client import SandboxClient
from tests.factories.simulations import DRIFT, FOLDERS, pushing

LANES = 8
pytestmark = pytest.mark.long


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
