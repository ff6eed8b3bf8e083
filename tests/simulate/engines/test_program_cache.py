"""What a program follows from: whatever is different of it makes another program."""

import importlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tasks.simulate.engines import program_cache
from tasks.simulate.engines.program import lane_mesh, lane_sharding, split_over
from tasks.simulate.engines.program_cache import (
    ProgramCache,
    applications_identity,
    module_dependencies,
    use_cache_folder,
)
from tests.factories.simulations import FOLDERS, ROBOT, SCENARIO
from tests.repository import ROOT

LAUNCHES = (ROBOT, SCENARIO)
BUNDLES = (FOLDERS[ROBOT.digest], FOLDERS[SCENARIO.digest])
KNOWN = applications_identity(LAUNCHES, BUNDLES, ("SPEED",), {"MODE": "fast"})


def test_launches_names_and_texts_are_part_of_it():
    other = ROBOT.model_copy(update={"launch_file": "other"})
    found = {
        KNOWN,
        applications_identity((other, SCENARIO), BUNDLES, ("SPEED",), {"MODE": "fast"}),
        applications_identity(LAUNCHES, BUNDLES, ("TIME",), {"MODE": "fast"}),
        applications_identity(LAUNCHES, BUNDLES, ("SPEED",), {"MODE": "slow"}),
        applications_identity((ROBOT.model_copy(update={"digest": "1" * 64}), SCENARIO), BUNDLES, ("SPEED",), {}),
    }
    assert len(found) == 5


def test_any_file_of_a_folder_that_is_no_sealed_bundle_is_part_of_it(tmp_path: Path):
    for folder in BUNDLES:
        shutil.copytree(folder, tmp_path / folder.name)
    copies = (tmp_path / BUNDLES[0].name, tmp_path / BUNDLES[1].name)
    before = applications_identity(LAUNCHES, copies, (), {})
    assert applications_identity(LAUNCHES, copies, (), {}) == before
    (copies[1] / "map.bin").write_bytes(b"another map")
    assert applications_identity(LAUNCHES, copies, (), {}) != before


def test_a_text_that_names_a_file_makes_a_program_that_is_not_kept(tmp_path: Path):
    assert KNOWN
    assert applications_identity(LAUNCHES, BUNDLES, (), {"MAP": str(tmp_path)}) == ""
    assert applications_identity(LAUNCHES, BUNDLES, (), {"MAP": str(tmp_path / "nothing")}) != ""
    assert applications_identity(LAUNCHES, BUNDLES, (), {"LONG": "/" + "x" * 9000}) != ""


def test_a_mounted_data_source_lies_where_its_digest_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path))
    mount = tmp_path / "data" / "mounts" / ("0" * 64) / "files"
    mount.mkdir(parents=True)
    assert applications_identity(LAUNCHES, BUNDLES, (), {"MAP": str(mount)}) != ""


MESH = lane_mesh()
LANES = 8 * MESH.size
INPUTS = np.linspace(0.0, 1.0, LANES * 3, dtype=np.float32).reshape(LANES, 3)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of kept programs of the test's own."""
    monkeypatch.setattr(program_cache, "_folders", [])
    use_cache_folder(tmp_path / "kept")
    return tmp_path / "kept"


class Counted:
    """A function of lanes that counts how often it was traced."""

    def __init__(
        self, kernel: Callable[[jax.Array], object] = lambda x: {"out": (jnp.sin(x) * 3, [x > 0, None])}
    ) -> None:
        self.traces, self._kernel = 0, kernel

    def __call__(self, inputs: jax.Array) -> object:
        self.traces += 1
        return self._kernel(inputs)


def put(inputs: np.ndarray) -> jax.Array:
    """Returns lanes split over the devices, as programs have them."""
    return jax.device_put(inputs, lane_sharding(MESH))


def run(function: Counted, identity: str = "one", name: str = "f", inputs: np.ndarray = INPUTS) -> object:
    """Runs a function as a new process would: by a cache and a jit of its own."""
    whole = split_over(MESH, function, 1)
    return jax.jit(ProgramCache(lane_sharding(MESH), identity).cached(name, whole))(put(inputs))


def traced(**other: object) -> int:
    """Returns how often a function is traced once one like it was kept."""
    run(Counted())
    function = Counted()
    run(function, **other)  # pyright: ignore[reportArgumentType] - each test's own
    return function.traces


def test_what_was_kept_is_not_traced():
    assert traced() == 0


def test_another_identity_name_or_shape_is_traced():
    assert traced(identity="two") > 0
    assert traced(name="g") > 0
    assert traced(inputs=np.concatenate([INPUTS, INPUTS])) > 0
    assert traced(inputs=INPUTS.astype(np.int32)) > 0


def test_a_program_without_identity_is_never_kept(folder: Path):
    assert traced(identity="") > 0
    run(Counted(), identity="")
    assert len(list(folder.iterdir())) == 1


def test_what_is_loaded_gives_the_same_bits_as_what_is_traced():
    plain = jax.jit(split_over(MESH, Counted(), 1))(put(INPUTS))
    for _ in range(2):
        again = run(Counted())
        assert jax.tree.structure(again) == jax.tree.structure(plain)
        for one, other in zip(jax.tree.leaves(again), jax.tree.leaves(plain), strict=True):
            assert np.asarray(one).tobytes() == np.asarray(other).tobytes()
            assert one.sharding.is_equivalent_to(other.sharding, one.ndim)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda _: b"",
        lambda body: body[:-7],
        lambda body: body.replace(b'"whole": true', b'"whole": "perhaps"'),
        lambda body: body[: body.index(b"\n") + 1] + bytes(len(body)),
        lambda _: bytes(1000),
    ],
)
def test_a_spoiled_file_is_traced_as_if_nothing_were_there(folder: Path, spoil: Callable[[bytes], bytes]):
    run(Counted())
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes(spoil(whole))
    function = Counted()
    run(function)
    assert function.traces > 0
    assert path.read_bytes().partition(b"\n")[2]
    assert traced() == 0


def test_a_changed_module_from_elsewhere_is_traced_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    module = tmp_path / "simyard_elsewhere.py"
    module.write_text("FACTOR = 2")
    monkeypatch.syspath_prepend(tmp_path)
    __import__("simyard_elsewhere")
    assert traced() == 0
    module.write_text("FACTOR = 3")
    function = Counted()
    run(function)
    assert function.traces > 0


def test_what_calls_the_host_back_runs_and_is_not_kept():
    called: list[int] = []

    def back(x: jax.Array) -> jax.Array:
        def host(y: np.ndarray) -> np.ndarray:
            called.append(1)
            return np.asarray(y)

        return jax.pure_callback(host, jax.ShapeDtypeStruct(x.shape, x.dtype), x)

    for _ in range(2):
        function, before = Counted(back), len(called)
        assert np.array_equal(np.asarray(run(function)), np.asarray(INPUTS))
        assert function.traces > 0
        assert len(called) > before


def test_a_type_of_an_applications_own_is_not_kept(folder: Path):
    class Own(NamedTuple):
        value: jax.Array

    for _ in range(2):
        function = Counted(Own)
        assert isinstance(run(function), Own)
        assert function.traces > 0
    assert all(b'"whole": false' in path.read_bytes() for path in folder.iterdir())


def test_an_exception_while_tracing_is_the_functions_own_and_keeps_nothing(folder: Path):
    def fail(_: jax.Array) -> object:
        raise LookupError("no way")

    with pytest.raises(LookupError, match="no way"):
        run(Counted(fail))
    assert not folder.exists()


def test_two_at_once_both_run():
    results: list[object] = []
    threads = [Thread(target=lambda: results.append(run(Counted()))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 2
    assert traced() == 0


def test_a_folder_that_cannot_be_written_to_keeps_nothing(tmp_path: Path):
    (tmp_path / "file").write_text("no folder")
    use_cache_folder(tmp_path / "file" / "kept")
    function = Counted()
    run(function)
    assert function.traces > 0


def test_a_check_that_was_passed_is_known_for_its_shapes_and_values():
    cache = ProgramCache(lane_sharding(MESH), "one")
    assert not cache.passed("check", INPUTS, [1.0])
    cache.note_passed("check", INPUTS, [1.0])
    assert cache.passed("check", INPUTS + 1, [1.0])
    assert not cache.passed("check", INPUTS, [2.0])
    assert not cache.passed("check", INPUTS[:1], [1.0])
    assert not ProgramCache(lane_sharding(MESH), "two").passed("check", INPUTS, [1.0])


def test_passed_checks_crowd_out_no_program(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(program_cache, "_FILES_AT_MOST", 3)
    run(Counted())
    for number in range(4):
        ProgramCache(lane_sharding(MESH), "one").note_passed("check", INPUTS, [number])
    assert traced() == 0


def test_of_passed_checks_the_oldest_go_first(folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(program_cache, "_FILES_AT_MOST", 3)
    cache = ProgramCache(lane_sharding(MESH), "one")
    for number in range(5):
        cache.note_passed("check", INPUTS, [number])
        newest = max(folder.iterdir(), key=lambda path: path.stat().st_mtime_ns)
        os.utime(newest, (number, number))
    assert [cache.passed("check", INPUTS, [number]) for number in range(5)] == [False, False, True, True, True]


def test_no_module_of_simyard_is_a_dependency():
    importlib.import_module("tasks.storage.store_url")
    importlib.import_module("simyard")
    roots = [ROOT / name for name in ("specs", "tasks", "flows", "simyard")]
    paths = [Path(each.path) for each in module_dependencies()]
    assert not [path for path in paths if any(path.is_relative_to(root) for root in roots)]
