"""Whatever docs/guide/worlds.md tells one to type, typed, from its first block to its last."""

from pathlib import Path

import pytest

from tests.docs.typed_blocks import begin_in, blocks_of, typed
from tests.integration.runs import finished

BLOCKS = blocks_of("docs/guide/worlds.md")


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.usefixtures("prefect_server")
def test_every_block_runs_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    begin_in(tmp_path, monkeypatch)
    for language, text in BLOCKS:
        told = typed(language, text)
        if language == "yaml":
            assert finished("plan", "document.yaml").returncode == 0
        else:
            assert told.strip()


def test_there_are_blocks_of_each_language():
    assert {language for language, _ in BLOCKS} == {"sh", "python", "sql", "yaml"}
