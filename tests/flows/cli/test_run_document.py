"""The server of a run: checked before the run begins, and reached past proxies."""

import json
import os
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from flows.cli import run_command
from flows.cli.shell import app
from flows.prefect import prefect_server as server_module
from flows.prefect.prefect_server import prefect_server
from specs.errors import DocumentError, StageFailed
from specs.pipeline.document import PipelineSpec
from tasks.server.health import succeeds_within
from tests.factories.gateway.answering_server import NOBODY, answering
from tests.integration.runs import finished
from tests.repository import ROOT

_PREPARE = """
import json, sys
from pathlib import Path
from flows.cli.run_command import _prepare_engine
from tasks.documents.pipeline_file import read_pipeline

_prepare_engine(read_pipeline(Path(sys.argv[1])))
print(json.dumps(sorted(sys.modules)))
"""


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction] - used by every test
    monkeypatch.setattr(server_module, "succeeds_within", lambda question: succeeds_within(question, for_s=0.0))


def test_a_server_that_does_not_answer_is_told_before_anything_runs(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PREFECT_API_URL", NOBODY)
    with pytest.raises(StageFailed, match=f"no Prefect server answers at PREFECT_API_URL={NOBODY}; unset it"):
        prefect_server().__enter__()


def test_a_local_server_is_reached_past_the_proxy(monkeypatch: pytest.MonkeyPatch):
    for name in ("no_proxy", "NO_PROXY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("http_proxy", NOBODY)
    with answering() as api_url:
        monkeypatch.setenv("PREFECT_API_URL", api_url)
        with prefect_server() as used:
            assert used.api_url == api_url
            assert os.environ["no_proxy"] == os.environ["NO_PROXY"] == "127.0.0.1,localhost"
    assert "no_proxy" not in os.environ


def test_a_proxy_that_prefects_client_cannot_use_does_not_stand_before_a_local_server(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("ALL_PROXY", "socks4://127.0.0.1:9")
    with answering() as api_url:
        monkeypatch.setenv("PREFECT_API_URL", api_url)
        with prefect_server():
            assert "ALL_PROXY" not in os.environ
    assert os.environ["ALL_PROXY"] == "socks4://127.0.0.1:9"


def test_a_proxy_that_prefects_client_cannot_use_is_refused_by_name_before_a_server_elsewhere(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setenv("ALL_PROXY", "socks4://127.0.0.1:9")
    monkeypatch.setenv("PREFECT_API_URL", "https://prefect.example.org/api")
    with pytest.raises(DocumentError, match=r"environment variable ALL_PROXY: 'socks4://127.0.0.1:9'"):
        prefect_server().__enter__()


def test_what_is_no_api_of_prefects_is_told_before_anything_runs(monkeypatch: pytest.MonkeyPatch):
    with answering(body=b"<html>") as api_url:
        monkeypatch.setenv("PREFECT_API_URL", api_url.removesuffix("/api"))
        with pytest.raises(StageFailed, match="is no API of Prefect's: its address ends with /api"):
            prefect_server().__enter__()


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("PREFECT_LOGGING_LEVEL", "LOUD"),
        ("PREFECT_LOGGING_SETTINGS_PATH", "/dev/null"),
        ("PREFECT_RESULTS_DEFAULT_SERIALIZER", "odd"),
        ("PREFECT_DEFAULT_RESULT_STORAGE_BLOCK", "x"),
        ("PREFECT_API_SSL_CERT_FILE", "/nowhere"),
    ],
)
def test_a_setting_that_prefect_does_not_take_is_a_fault_of_the_environment(name: str, value: str):
    program = "from flows.prefect.prefect_server import require_prefect_settings as require; require()"
    own = {"PREFECT_API_URL": "https://127.0.0.1:9/api", name: value}
    done = subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, **own}, capture_output=True, text=True, check=False
    )
    last = done.stderr.splitlines()[-1]
    assert last.startswith("  environment: ")
    assert f"{name}" in last.partition("what this Prefect takes")[0]


def test_a_chosen_server_wins_over_the_kept_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    monkeypatch.setattr(server_module, "kept_server", pytest.fail)
    with answering() as api_url:
        monkeypatch.setenv("PREFECT_API_URL", api_url)
        with prefect_server() as used:
            assert used.api_url == api_url


def test_the_client_asks_for_longer_than_a_server_is_waited_for(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("PREFECT_CLIENT_MAX_RETRIES", raising=False)
    with answering() as api_url:
        monkeypatch.setenv("PREFECT_API_URL", api_url)
        with prefect_server() as used:
            shortest_s = sum(0.8 * 2**pause for pause in range(1, int(os.environ["PREFECT_CLIENT_MAX_RETRIES"]) + 1))
            assert shortest_s >= used.wait_s == 90
        monkeypatch.setenv("PREFECT_CLIENT_MAX_RETRIES", "1")
        with prefect_server():
            assert os.environ["PREFECT_CLIENT_MAX_RETRIES"] == "1"


@pytest.mark.parametrize(
    ("document", "computes_with"),
    [
        ("worlds-only", {"mujoco", "scipy"}),
        pytest.param("quickstart", {"mujoco", "scipy"}, marks=pytest.mark.long),
    ],
)
def test_a_run_prepares_what_its_document_computes_with(document: str, computes_with: set[str]):
    command = [sys.executable, "-c", _PREPARE, f"examples/{document}.yaml"]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    modules = set(json.loads(ended.stdout))
    assert modules & {"jax", "mujoco", "scipy"} == computes_with
    assert {"flows.prefect.flows", "prefect.flow_engine", "prefect.task_engine"} <= modules


def test_a_document_with_faults_is_refused_before_a_server_is_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(run_command, "prefect_server", pytest.fail)
    spec = PipelineSpec.model_validate(
        {"name": "worlds", "worldGeneration": {"template": "missing.json", "worldCount": {}, "seed": 1}}
    )
    with pytest.raises(DocumentError, match=r"missing\.json"):
        run_command.run_document(spec, tmp_path, (tmp_path / "store").as_uri(), Console())


def test_a_server_waits_in_reserve_where_none_is_chosen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    homes: list[Path] = []
    monkeypatch.setattr(server_module.process, "reserve_server", lambda home: (homes.append(home), nullcontext())[1])
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    monkeypatch.setenv("PREFECT_API_URL", NOBODY)
    with server_module.server_in_reserve():
        assert homes == []
    monkeypatch.delenv("PREFECT_API_URL")
    with server_module.server_in_reserve():
        assert homes == [tmp_path]


def test_a_document_is_read_while_a_server_waits_in_reserve(monkeypatch: pytest.MonkeyPatch):
    begun: list[str] = []
    monkeypatch.setattr(server_module, "server_in_reserve", lambda: (begun.append("reserve"), nullcontext())[1])
    for options, expected in (([], ["reserve"]), (["--direct"], [])):
        begun.clear()
        assert CliRunner().invoke(app, ["run", "missing.yaml", *options]).exit_code != 0
        assert begun == expected


@pytest.mark.integration
@pytest.mark.long
def test_a_block_for_results_that_the_server_does_not_have_is_named_with_what_to_do(tmp_path: Path) -> None:
    file, block = ROOT / "examples/worlds-only.yaml", "remote-file-system/none"
    done = finished("run", str(file), "--store", tmp_path.as_uri(), PREFECT_DEFAULT_RESULT_STORAGE_BLOCK=block)
    assert done.returncode == 2
    assert "PREFECT_DEFAULT_RESULT_STORAGE_BLOCK: 'remote-file-system/none'" in done.stderr
    assert "defect" not in done.stderr
