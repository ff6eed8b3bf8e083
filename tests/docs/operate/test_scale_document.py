"""docs/operate/scale.md: its commands are there, its figures come from them, and what it says of pieces is so."""

import re
import sys
from importlib import import_module

import pytest

from benchmarks.harness import with_tables
from flows.prefect.worker_cluster import PieceSize
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/operate/scale.md").read_text()


@pytest.mark.parametrize("command", re.findall(r"`\.venv/bin/python -m (benchmarks\.[\w.]+ [^`]*)`", DOCUMENT))
def test_a_command_is_one_that_there_is(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module, *options, document = command.split()
    monkeypatch.setattr(sys, "argv", [module, "--help"])
    with pytest.raises(SystemExit, match="0"):
        import_module(module).main()
    told = capsys.readouterr().out
    assert all(option in told for option in options)
    assert (ROOT / document).exists()


@pytest.mark.parametrize("name", ["scale crews", "scale plan"])
def test_figures_are_there_and_have_their_place(name: str) -> None:
    table = DOCUMENT.partition(f"<!-- {name} -->")[2].partition("<!-- end")[0]
    assert len(re.findall(r"^\| .*\d.*\|$", table, re.MULTILINE)) >= 4
    assert "figures" in with_tables(DOCUMENT, name, "figures")


def test_a_piece_is_as_long_as_it_says() -> None:
    shortest_s, a_worker_s, workers = re.findall(
        r"A piece lasts (\d+) seconds, or ([\d.]+) seconds for each worker where there are more than (\d+)",
        " ".join(DOCUMENT.split()),
    )[0]
    pace = PieceSize()
    pace.learn(1, 0.1)
    assert 0.1 * pace.size(10**9, 1) == pytest.approx(float(shortest_s))
    assert 0.1 * pace.size(10**9, int(workers)) == pytest.approx(float(shortest_s))
    assert 0.1 * pace.size(10**9, 1000) == pytest.approx(1000 * float(a_worker_s))
