"""Networks of episodes, and what the keeper does when this process is gone."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tasks.ros.process.application_processes import marked
from tasks.ros.process.network import EpisodeNetwork, EpisodeNetworks
from tests.repository import ROOT


def two(networks: EpisodeNetworks) -> tuple[EpisodeNetwork, EpisodeNetwork]:
    if networks.shared:
        pytest.skip(networks.shared)
    return networks.new(), networks.new()


def test_two_episodes_may_take_the_same_port(tmp_path: Path) -> None:
    with EpisodeNetworks(tmp_path / "homes") as networks:
        one, other = two(networks)
        for each in (one, other):
            with each.new_socket() as sock:
                sock.bind(("127.0.0.1", 8080))
                sock.listen()
                program = "import socket; socket.create_connection(('127.0.0.1', 8080))"
                subprocess.run([*each.prefix, sys.executable, "-I", "-S", "-c", program], check=True)
            each.close()


def test_a_network_has_its_own_loopback_and_nothing_else(tmp_path: Path) -> None:
    with EpisodeNetworks(tmp_path / "homes") as networks:
        own, _ = two(networks)
        shown = subprocess.run([*own.prefix, "cat", "/proc/net/dev"], capture_output=True, text=True, check=True)
        assert [line.split(":")[0].strip() for line in shown.stdout.splitlines()[2:]] == ["lo"]


# A process of its own: it holds few files, whatever the tests before it left open in this one.
FEW_FILES = """
import resource, sys
from pathlib import Path
from tasks.ros.process.network import EpisodeNetworks
limits = resource.getrlimit(resource.RLIMIT_NOFILE)
resource.setrlimit(resource.RLIMIT_NOFILE, (32, limits[1]))  # the keeper inherits it, and holds a file for each
with EpisodeNetworks(Path(sys.argv[1])) as networks:
    resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    held = [networks.new() for _ in range(2)]
    try:
        held += [networks.new() for _ in range(64)]
    except OSError as exc:
        print(len(held), repr(networks.shared), exc)
"""


def test_episodes_share_a_network_all_or_none(tmp_path: Path) -> None:
    """The kernel bounds the number of networks; an episode in the shared one would hear its neighbours."""
    with EpisodeNetworks(tmp_path / "mine") as networks:
        two(networks)
    command = [sys.executable, "-c", FEW_FILES, str(tmp_path / "homes")]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert ended.stdout.startswith("2 '' "), ended.stdout
    assert "no network for another episode" in ended.stdout


def test_who_is_killed_leaves_no_process_and_no_file(tmp_path: Path) -> None:
    homes = tmp_path / "homes"
    (homes / "lane-0").mkdir(parents=True)
    program = (
        "import subprocess, sys, time\nfrom pathlib import Path\n"
        "from tasks.ros.process.network import EpisodeNetworks\n"
        "root = Path(sys.argv[1]); networks = EpisodeNetworks(root); own = networks.new()\n"
        "node = [*own.prefix, 'env', '-i', f'ROS_HOME={root}/lane-0', 'sleep', '600']\n"
        "subprocess.Popen(node, start_new_session=True)\n"
        "print('there', flush=True); time.sleep(600)"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    holder = subprocess.Popen([sys.executable, "-c", program, str(homes)], stdout=subprocess.PIPE, env=environment)
    assert holder.stdout is not None
    assert holder.stdout.readline() == b"there\n"
    while not marked([homes / "lane-0"]):
        time.sleep(0.01)
    holder.send_signal(signal.SIGKILL)
    holder.communicate()
    while homes.exists() or marked([homes / "lane-0"]):
        time.sleep(0.01)
