"""Applications that exit, hang, print and look around: each has its row, and the run that asked goes on."""

import os
import socket
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult, Failure, failed_result
from specs.data.world import World
from tasks.simulate.lane.recording import Columns, Recorder, RecordingChoice
from tasks.simulate.plan.chunks import Chunk, plan_chunks
from tasks.simulate.sandbox import sandbox_client as lanes_module
from tasks.simulate.sandbox import simulator
from tasks.simulate.sandbox.confinement import confinement
from tasks.simulate.sandbox.sandbox_client import SandboxClient
from tests.factories.simulations import BUNDLES, DRIFT, ENDLESS, FAULTY, FOLDERS, pushing, simulate_lanes

LANES = 4
HOSTILE = "b" * 64
SOUND, LEAVES, SLEEPS, INTERRUPTS, TELLS, WRITES, CONNECTS, LOOKS, PRINTS = range(9)
EXITS, COMPLEX, NOTHING, BOOLS, TEXTS = range(9, 14)
DRIVING = ApplicationLaunch(name="hostile", version="1", digest=HOSTILE, package="hostile", launch_file="driving")
KEYS = "/where/keys/are"
needs_bubblewrap = pytest.mark.skipif(
    confinement().level != "bubblewrap" and os.environ.get("CI") != "true", reason=confinement().why or "there"
)


@pytest.fixture(scope="module")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The test's applications, whose folders are this module's alone."""
    return {HOSTILE: BUNDLES / "hostile", DRIFT: FOLDERS[DRIFT]}


@pytest.fixture(autouse=True)
def keys(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_KEYS", KEYS)


def chunk_of(faults: list[int], launch_file: str = "driving") -> Chunk:
    robot = DRIVING.model_copy(update={"launch_file": launch_file})
    requests: list[EpisodeRequest] = [
        pushing(index, world="hand/pen-0", seed=index, fault=str(fault)).model_copy(
            update={"robot": robot, "scenario": ENDLESS}
        )
        for index, fault in enumerate(faults)
    ]
    (chunk,) = plan_chunks(requests, LANES)
    return chunk


Run = Callable[..., list[EpisodeResult]]


@pytest.fixture
def run(bundles: dict[str, Path], pens: dict[str, World]) -> Run:
    """Simulates episodes with these faults in a process of their own."""

    def rows(faults: list[int], launch_file: str = "driving", **more: object) -> list[EpisodeResult]:
        options = {"should_stop": lambda: False, **more}
        lanes = SandboxClient(bundles=bundles, lanes=LANES, engine="auto", **options)  # pyright: ignore[reportArgumentType]
        return lanes.simulate(chunk_of(faults, launch_file), pens).rows()

    return rows


@pytest.fixture(scope="module")
def sound(bundles: dict[str, Path], pens: dict[str, World]) -> list[EpisodeResult]:
    """The rows of sound episodes, simulated in this process."""
    return simulate_lanes(chunk_of([SOUND] * LANES), pens, bundles, lanes=LANES, should_stop=lambda: False)


def test_rows_and_recordings_are_those_of_a_run_in_this_process(
    run: Run, bundles: dict[str, Path], pens: dict[str, World], sound: list[EpisodeResult]
):
    here, apart = (Recorder(4.0, lambda _: True) for _ in range(2))
    chunk = chunk_of([SOUND] * LANES)
    simulate_lanes(chunk, pens, bundles, lanes=LANES, should_stop=lambda: False, recorder=here)
    assert run([SOUND] * LANES, recorder=apart, rate_hz=4.0) == sound
    for ours, theirs in zip(here.parts(), apart.parts(), strict=True):
        assert {name: values.tobytes() for name, values in ours.items()} == {
            name: values.tobytes() for name, values in theirs.items()
        }


@pytest.mark.long
def test_of_episodes_that_nobody_keeps_no_samples_are_told(pens: dict[str, World], monkeypatch: pytest.MonkeyPatch):
    bundles = {digest: FOLDERS[digest] for digest in (DRIFT, FAULTY)}
    here, apart = (Recorder(4.0, lambda rows: np.isin(rows.index, (1, 3))) for _ in range(2))
    told: list[int] = []
    begin = apart.begin

    def begins(lanes: int, control_s: float) -> None:
        told.append(lanes)
        begin(lanes, control_s)

    monkeypatch.setattr(apart, "begin", begins)
    (chunk,) = plan_chunks([pushing(k, world="hand/pen-0", seed=k, duration_s=1.0 + k) for k in range(LANES)], LANES)
    alone = simulate_lanes(chunk, pens, bundles, lanes=LANES, should_stop=lambda: False, recorder=here)
    wanted = RecordingChoice(always=(1, 3))
    lanes = SandboxClient(bundles, LANES, "auto", lambda: False, rate_hz=4.0, recorder=apart, recorded=wanted)
    assert lanes.simulate(chunk, pens).rows() == alone
    assert told == [2]
    assert apart.episodes == [1, 3]
    assert [_bytes(part) for part in apart.parts()] == [_bytes(part) for part in here.parts()]


def _bytes(columns: Columns) -> dict[str, bytes]:
    return {name: values.tobytes() for name, values in columns.items()}


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (EXITS, "controller.step: SystemExit: 0"),
        (INTERRUPTS, "controller.step: KeyboardInterrupt: "),
        (COMPLEX, "controller.step: control of complex128, not of real numbers"),
        (NOTHING, "controller.step: control of object, not of real numbers"),
        (BOOLS, "controller.step: control of bool, not of real numbers"),
        (TEXTS, "controller.step: control of <U1, not of real numbers"),
    ],
)
def test_what_a_controller_raises_or_returns_is_the_row_of_its_lane_alone(
    run: Run, sound: list[EpisodeResult], fault: int, reason: str
):
    rows = run([SOUND, fault, SOUND, SOUND])
    assert (rows[1].status, rows[1].failure_code) == ("Failed", "RobotApplicationCrash")
    assert rows[1].failure_reason.startswith(reason)
    assert [rows[0], *rows[2:]] == [sound[0], *sound[2:]]


def test_an_application_sees_neither_keys_nor_credentials_nor_addresses(run: Run, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:1/api")
    reason = run([TELLS])[0].failure_reason
    assert "PATH" in reason
    assert not any(name in reason for name in ("SIMYARD_KEYS", "SIMYARD_STORE", "AWS_", "PREFECT_"))


@needs_bubblewrap
def test_in_bubblewrap_an_application_has_no_file_to_write_no_network_and_no_parent_to_read(
    run: Run, sound: list[EpisodeResult]
):
    with socket.create_server(("127.0.0.1", 0)):
        wrote, connected, looked, _ = run([WRITES, CONNECTS, LOOKS, SOUND])
    assert wrote == sound[0]  # it could write nowhere
    assert "OSError" in connected.failure_reason or "ConnectionRefusedError" in connected.failure_reason
    assert "SIMYARD_KEYS False" in looked.failure_reason or "PermissionError" in looked.failure_reason


def test_what_applications_print_is_kept(run: Run, sound: list[EpisodeResult]):
    printed: list[str] = []
    assert run([PRINTS, SOUND, SOUND, SOUND], printed=printed.append) == sound
    assert "I see something" in "".join(printed)


@pytest.mark.long
def test_a_chunk_ahead_that_ends_the_process_takes_no_row_from_the_chunk_before_it(pens: dict[str, World]):
    bundles = {HOSTILE: BUNDLES / "hostile", DRIFT: FOLDERS[DRIFT], FAULTY: FOLDERS[FAULTY]}
    (chunk,) = plan_chunks([pushing(0, world="hand/pen-0", duration_s=1.0)], LANES)
    here, apart = (Recorder(4.0, lambda _: True) for _ in range(2))
    alone = simulate_lanes(chunk, pens, bundles, lanes=LANES, should_stop=lambda: False, recorder=here)
    ahead = [chunk_of([SOUND], "leaves")]
    lanes = SandboxClient(bundles, LANES, "auto", should_stop=lambda: False, rate_hz=4.0, recorder=apart, ahead=ahead)
    assert lanes.simulate(chunk, pens).rows() == alone
    assert [part["pose"].tobytes() for part in apart.parts()] == [part["pose"].tobytes() for part in here.parts()]


@pytest.mark.long
def test_an_application_that_ends_its_process_has_its_row_and_the_others_are_as_without_it(
    run: Run, sound: list[EpisodeResult]
):
    rows = run([SOUND, SOUND, LEAVES, SOUND])
    assert (rows[2].status, rows[2].failure_code) == ("Failed", "RobotApplicationCrash")
    assert rows[2].failure_reason.startswith("the process ended with exit code 0 during controller.step")
    assert [*rows[:2], rows[3]] == [*sound[:2], sound[3]]


@pytest.mark.long
@pytest.mark.parametrize(
    ("launch_file", "reason"),
    [
        ("exits", "hostile: importing hostile/exits.py: SystemExit: 0 (hostile/exits.py, line 6: sys.exit(0))"),
        (
            "interrupts",
            "hostile: importing hostile/interrupts.py: KeyboardInterrupt: "
            " (hostile/interrupts.py, line 4: raise KeyboardInterrupt)",
        ),
        ("leaves", "the process ended with exit code 0 during hostile: importing hostile/leaves.py"),
        ("hangs", "hostile: importing hostile/hangs.py took longer than 2 s (SIMYARD_IMPORT_LIMIT_S)"),
    ],
)
def test_an_application_that_does_not_import_fails_all_its_episodes_with_the_reason(
    run: Run, launch_file: str, reason: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_IMPORT_LIMIT_S", "2")
    rows = run([SOUND, SOUND], launch_file)
    assert {(row.status, row.failure_code) for row in rows} == {("Failed", "RobotApplicationCrash")}
    assert {row.failure_reason for row in rows} == {" ".join(reason.split())}


@pytest.mark.long
def test_a_step_that_takes_too_long_is_a_row(run: Run, sound: list[EpisodeResult], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_STEP_LIMIT_S", "3")
    rows = run([SOUND, SLEEPS])
    assert rows[0] == sound[0]
    assert rows[1].failure_reason == "controller.step took longer than 3 s (SIMYARD_STEP_LIMIT_S)"


@pytest.mark.long
def test_an_application_that_hangs_does_not_keep_a_run_from_stopping(run: Run, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(simulator, "_GRACE_S", 1.0)
    begun_s = time.monotonic()
    rows = run([SOUND, SLEEPS], should_stop=lambda: time.monotonic() - begun_s > 8.0)
    assert {row.status for row in rows} == {"Canceled"}


def test_chunks_ahead_that_the_memory_was_too_little_for_are_not_begun_again(
    monkeypatch: pytest.MonkeyPatch, bundles: dict[str, Path], pens: dict[str, World]
):
    asked: list[int] = []

    def rows_of(_: SandboxClient, chunk: Chunk, *given: object) -> list[EpisodeResult]:
        ahead = given[2] if len(given) > 2 else ()
        asked.append(len(ahead) if isinstance(ahead, list) else 0)
        if not asked[-1]:
            return [failed_result(request.index, Failure("RobotApplicationCrash", "")) for request in chunk.requests]
        ended = simulator.SimulatorEnded("it was ended by signal 9", None, "", status=-9)
        ended.beside_others = True
        raise ended

    monkeypatch.setattr(lanes_module, "_too_large_together", set())
    monkeypatch.setattr(SandboxClient, "_rows", rows_of)
    for _ in range(2):  # each chunk has its own
        lanes = SandboxClient(bundles, LANES, "auto", should_stop=lambda: False, ahead=[chunk_of([SOUND])])
        assert len(lanes.simulate(chunk_of([SOUND]), pens)) == 1
    assert asked == [1, 0, 0]
