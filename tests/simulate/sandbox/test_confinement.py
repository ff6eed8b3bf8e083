"""How the process that runs applications is shut in."""

import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from specs.errors import DocumentError, StageFailed
from tasks.simulate.sandbox import confinement as confinement_module
from tasks.simulate.sandbox import self_confinement
from tasks.simulate.sandbox.confinement import (
    Confinement,
    Level,
    Place,
    confined_command,
    confinement,
    programs_folder,
    require_confined,
)
from tasks.simulate.sandbox.process_environment import process_environment
from tasks.simulate.sandbox.self_confinement import OWN_NETWORK, PROBE
from tests.factories.simulations import BUNDLES, COURIER, DELIVERY, FOLDERS

PLACE = Place(Path("/programs"), Path("/own"))


def test_each_set_of_applications_has_a_folder_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path))
    assert programs_folder(["a" * 64, "b" * 64]) == programs_folder(["b" * 64, "a" * 64])
    assert programs_folder(["a" * 64]) != programs_folder(["b" * 64])


def test_where_ros_is_may_be_told_and_is_readable_then(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_ROS_PYTHON", "/where/ros/is/bin/python3")
    command = confined_command(PROBE, [], PLACE, [])
    assert confinement().level == "process" or "/where/ros/is" in " ".join(command)


@pytest.mark.parametrize("told", ["/ros/bin", "/home/owner/bin/python3", "bin/python3"])
def test_no_home_becomes_readable_for_it(monkeypatch: pytest.MonkeyPatch, told: str):
    monkeypatch.setenv("HOME", "/home/owner")
    monkeypatch.setenv("SIMYARD_ROS_PYTHON", told)
    assert not set(map(Path, ("/", "/home/owner", "."))).intersection(confinement_module._readable())


@pytest.mark.skipif(confinement().level != "bubblewrap", reason=confinement().why or "there")
def test_what_applications_may_write_is_bounded():
    command = confined_command(PROBE, [], PLACE, [])
    assert int(command[command.index("--size") + 1]) > 0
    assert command[command.index("--size") + 2 :][:2] == ["--tmpfs", "/tmp"]  # noqa: S108 - a new one


# What a stranger tries, each as a word and what came of it; told as JSON.
STRANGER = """
import json, os, resource, socket, subprocess, sys
from pathlib import Path
secret, outside, own = (Path(each) for each in sys.argv[1:])
found = {}

def tries(name, deed):
    try:
        found[name] = str(deed())
    except OSError as exc:
        found[name] = type(exc).__name__

tries("reads", secret.read_text)
tries("lists", lambda: os.listdir(secret.parent))
tries("cuts short", lambda: os.truncate(secret, 0))
tries("opens to all", lambda: os.chmod(secret, 0o777))
tries("writes outside", lambda: (outside / "x").write_text("x"))
tries("looks at its parent", lambda: b"SECRET" in Path(f"/proc/{os.getppid()}/environ").read_bytes())
tries("asks programs of this machine", lambda: socket.socket(socket.AF_UNIX).connect("/run/dbus/system_bus_socket"))
tries("asks the network", lambda: socket.create_connection(("127.0.0.1", int(os.environ["PORT"])), 2.0))
tries("sends a datagram", lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"x", ("192.0.2.1", 9)))
tries("writes its own", lambda: (own / "y").write_text("y"))
tries("starts a program", lambda: subprocess.run(["true"], check=True).returncode)
tries("writes much", lambda: os.posix_fallocate(os.open(own / "z", os.O_CREAT | os.O_WRONLY), 0, 2 << 30))
for name in ("CORE", "FSIZE", "NPROC", "AS"):
    found[name] = resource.getrlimit(getattr(resource, f"RLIMIT_{name}"))[1]
print(json.dumps(found))
"""
REFUSED = {"PermissionError", "FileNotFoundError", "ConnectionRefusedError", "OSError", "False"}
HERE = ("bubblewrap", "landlock")


def tells(level: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    """Returns what a stranger could do at a level of confinement, in a process whose parent has a secret."""
    monkeypatch.setenv("SIMYARD_CONFINEMENT", level)
    monkeypatch.setenv("SECRET", "SECRET")
    if confinement().level != level and os.environ.get("CI") != "true":
        pytest.skip(confinement().why)
    outside, own, programs = (tmp_path / name for name in ("outside", "own", "programs"))
    for each in (outside, own, programs):
        each.mkdir()
    (outside / "key").write_text("a secret")
    (programs / "stranger.py").write_text(STRANGER)
    place = Place(programs, own)
    environment = process_environment(os.environ, programs) | place.variables()
    environment["PYTHONPATH"] += f"{os.pathsep}{programs}"
    with socket.create_server(("127.0.0.1", 0)) as server:
        environment["PORT"] = str(server.getsockname()[1])
        command = confined_command("stranger", [str(outside / "key"), str(outside), str(programs)], place, [])
        done = subprocess.run(command, env=environment, cwd=own, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(autouse=True)
def asked_anew() -> Iterator[None]:
    """What shuts applications in is found out anew by each test."""
    confinement_module._settled.clear()
    yield
    confinement_module._settled.clear()


@pytest.mark.parametrize("level", HERE)
def test_strangers_code_reaches_no_file_process_or_network_of_this_machine(
    level: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    found = tells(level, tmp_path, monkeypatch)
    key = tmp_path / "outside/key"
    assert (key.read_text(), key.stat().st_mode & 0o077) == ("a secret", 0o044)
    tried = {name: what for name, what in found.items() if not name.isupper()}
    allowed = {"writes its own": "1", "starts a program": "0"}
    assert {name: tried.pop(name) for name in allowed} == allowed
    assert set(tried.values()) <= REFUSED, tried


@pytest.mark.parametrize("level", [*HERE, "process"])
def test_what_it_takes_of_memory_files_and_processes_is_limited(
    level: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(confinement_module, "device_kind", lambda: "cpu")
    found = tells(level, tmp_path, monkeypatch)
    assert found["writes much"] == "OSError"
    assert found["CORE"] == 0
    assert all(isinstance(most := found[name], int) and 0 < most < 1 << 45 for name in ("FSIZE", "NPROC", "AS"))


def test_a_python_that_was_called_by_a_way_around_is_shut_in_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    around = Path(sys.executable).parent / ".." / "bin" / Path(sys.executable).name
    monkeypatch.setattr(sys, "executable", str(around))
    monkeypatch.delenv("SIMYARD_CONFINEMENT", raising=False)
    assert not confinement().broken, confinement().why
    assert not any(".." in Path(word).parts for word in confined_command(PROBE, [], PLACE, []))


def test_only_what_is_needed_of_opt_and_of_the_folder_of_python_is_readable():
    readable = set(confinement_module._readable())
    assert not {Path("/opt"), Path("/"), Path(sys.prefix), Path(sys.base_prefix), Path.home()} & readable
    assert {path.parts[2][:4] for path in readable if path.parts[1] == "opt"} <= {"ros", "rocm"}


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A machine on which nothing shuts applications in, and a process that holds nothing."""
    set_confinement(monkeypatch, Confinement("process", "as told"))
    monkeypatch.setenv("XDG_CONFIG_HOME", "/nonexistent")
    for name in (
        *confinement_module._SECRETS,
        "SIMYARD_TRUST_APPLICATIONS",
        "SIMYARD_ACCESS_FILE",
        "SIMYARD_CONFINEMENT",
    ):
        monkeypatch.delenv(name, raising=False)
    return monkeypatch


def set_confinement(patch: pytest.MonkeyPatch, found: Confinement) -> None:
    patch.setattr(confinement_module, "confinement", lambda: found)


HOSTILE = [BUNDLES / "hostile", FOLDERS[DELIVERY]]


def test_who_holds_nothing_runs_any_application(bare: pytest.MonkeyPatch):
    require_confined(HOSTILE)


@pytest.mark.parametrize("name", confinement_module._SECRETS)
def test_who_holds_keys_or_works_for_others_runs_no_strangers_code_unconfined(bare: pytest.MonkeyPatch, name: str):
    bare.setenv(name, "it")
    with pytest.raises(StageFailed, match=r"nothing shuts them in .*, and this process has .*install"):
        require_confined(HOSTILE)
    bare.setenv("SIMYARD_TRUST_APPLICATIONS", "1")
    require_confined(HOSTILE)


def test_who_has_the_keys_of_a_gateway_where_they_are_looked_for_runs_no_strangers_code_unconfined(
    bare: pytest.MonkeyPatch, tmp_path: Path
):
    bare.setenv("XDG_CONFIG_HOME", str(tmp_path))
    require_confined(HOSTILE)
    (tmp_path / "simyard").mkdir()
    (tmp_path / "simyard" / "access-keys").write_text("")
    with pytest.raises(StageFailed, match=rf"has the keys of a gateway's clients \({tmp_path}.*install"):
        require_confined(HOSTILE)


def test_who_asked_for_no_confinement_is_told_to_ask_no_more(bare: pytest.MonkeyPatch):
    bare.setenv("SIMYARD_KEYS", "keys")
    bare.setenv("SIMYARD_CONFINEMENT", "process")
    with pytest.raises(StageFailed, match=r"\(SIMYARD_KEYS\): unset SIMYARD_CONFINEMENT; or, if all"):
        require_confined(HOSTILE)


@pytest.mark.parametrize("level", HERE)
def test_who_holds_keys_runs_what_is_shut_in(bare: pytest.MonkeyPatch, level: Level):
    bare.setenv("SIMYARD_KEYS", "keys")
    set_confinement(bare, Confinement(level))
    require_confined(HOSTILE)


def test_applications_that_come_with_simyard_run_anywhere_and_one_that_was_changed_does_not(
    bare: pytest.MonkeyPatch, tmp_path: Path
):
    bare.setenv("SIMYARD_KEYS", "keys")
    require_confined([FOLDERS[COURIER], FOLDERS[DELIVERY]])
    shutil.copytree(FOLDERS[COURIER], tmp_path / "courier")
    (tmp_path / "courier" / "more.py").write_text("")
    with pytest.raises(StageFailed):
        require_confined([tmp_path / "courier"])


def test_what_is_installed_and_does_not_work_is_no_leave_to_run(bare: pytest.MonkeyPatch):
    set_confinement(bare, Confinement("process", "bubblewrap does not work here: no namespaces", broken=True))
    advices = {"": r"; repair it, or .* SIMYARD_CONFINEMENT=landlock", "too old": r"; repair it; or, if all"}
    for why, advice in advices.items():
        bare.setattr(confinement_module, "_landlock_probe", lambda why=why: confinement_module._Trial(why))
        with pytest.raises(StageFailed, match="no namespaces" + advice):
            require_confined(HOSTILE)


@pytest.mark.parametrize("said", [OWN_NETWORK, "no network"])
def test_nodes_of_ros_are_shown_a_way_that_they_can_go_where_bubblewrap_does_not_work(
    said: str, bare: pytest.MonkeyPatch, tmp_path: Path
):
    (tmp_path / "package.xml").write_text("<package/>")
    set_confinement(bare, Confinement("process", "no namespaces", broken=True))
    bare.setattr(confinement_module, "_landlock_probe", lambda: confinement_module._Trial("", said))
    way = "or choose another confinement: SIMYARD_CONFINEMENT=landlock"
    advice = way if said == OWN_NETWORK else "or for your own nodes SIMYARD_CONFINEMENT=process"
    with pytest.raises(StageFailed, match=f"no namespaces; repair it, {advice}; or, if all"):
        require_confined([tmp_path])


def test_nodes_of_ros_do_not_run_where_they_could_not_reach_each_other(bare: pytest.MonkeyPatch, tmp_path: Path):
    (tmp_path / "patrol").mkdir()
    (tmp_path / "patrol" / "package.xml").write_text("<package/>")
    set_confinement(bare, Confinement("landlock", network=False))
    require_confined(HOSTILE)
    with pytest.raises(StageFailed, match="none of their own on this machine: apt-get install bubblewrap"):
        require_confined([tmp_path])


@pytest.mark.parametrize(("take", "taken"), [("1 / 0", "False"), ("False", "False"), ("True", "True")])
def test_a_network_that_cannot_be_switched_on_is_as_good_as_none(take: str, taken: str):
    # In a process of its own, as it happens: before anything has a thread.
    code = f"import {self_confinement.__name__} as own; own._take_network = lambda: {take}"
    asked = [sys.executable, "-c", f"{code}; print(own._may_take_network())"]
    told = subprocess.run(asked, capture_output=True, text=True, check=True)
    assert told.stdout.strip() == taken


def test_a_bubblewrap_that_does_not_start_is_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "bwrap").write_text("#!/bin/sh\necho no namespaces >&2; exit 1\n")
    (tmp_path / "bwrap").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.delenv("SIMYARD_CONFINEMENT", raising=False)
    assert confinement() == Confinement("process", "bubblewrap does not work here: no namespaces", broken=True)


def test_a_confinement_that_was_slow_or_was_repaired_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "bwrap").write_text(f"#!/bin/sh\ntest -e {tmp_path}/quick || exec sleep 600\n")
    (tmp_path / "bwrap").chmod(0o755)
    monkeypatch.setattr(confinement_module, "_PROBE_S", 0.2)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.delenv("SIMYARD_CONFINEMENT", raising=False)
    why = "bubblewrap does not work here: trying it took longer than 0.2 s"
    assert confinement() == Confinement("process", why, broken=True)
    (tmp_path / "quick").touch()
    assert confinement() == Confinement("bubblewrap")
    (tmp_path / "quick").unlink()
    assert confinement() == Confinement("bubblewrap")


def test_landlock_that_was_too_slow_to_be_tried_is_no_leave_to_run(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.setattr(confinement_module, "_landlock_probe", lambda: confinement_module._Trial("slow", slow=True))
    monkeypatch.delenv("SIMYARD_CONFINEMENT", raising=False)
    assert confinement().broken


def test_a_bubblewrap_that_was_asked_for_and_is_not_installed_is_told_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("SIMYARD_CONFINEMENT", "bubblewrap")
    found = confinement()
    assert (found.level, found.broken) == ("process", True)
    assert "No such file or directory: 'bwrap'" in found.why


@pytest.mark.parametrize("home", ["/nix/store", "/gnu/store"])
def test_a_python_of_a_store_of_packages_has_what_it_is_linked_with(home: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "base_prefix", f"{home}/0abc-python3-3.11.9")
    assert Path(home) in confinement_module._readable()
    monkeypatch.undo()
    assert Path(home) not in confinement_module._readable()


def test_a_confinement_that_there_is_not_is_a_fault(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_CONFINEMENT", "none")
    with pytest.raises(DocumentError, match="SIMYARD_CONFINEMENT: 'none': bubblewrap, landlock, process"):
        confinement()
