"""Whatever docs/reference/engines.md tells one to type, typed, from its first block to its last."""

from pathlib import Path

import pytest

from tests.docs.typed_blocks import begin_in, blocks_of, typed


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.usefixtures("prefect_server")
def test_every_block_runs_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    begin_in(tmp_path, monkeypatch)
    blocks = blocks_of("docs/reference/engines.md")
    told = [typed(language, text) for language, text in blocks]
    assert [language for language, _ in blocks] == ["yaml", "sh", "sql"]
    assert "courier: engine mujoco, asked for" in told[1]
    assert told[2].startswith("('mujoco', 'cpu', 8, ")
