"""Programs that nobody here wrote, and that say whether a file is what it claims to be."""

import functools
import json
import os
import subprocess
import tempfile
from pathlib import Path

from tests.servers.tools import need_tool, skip_or_fail

_NPM_PACKAGE = "gltf-validator@2.0.0-dev.3.10"
_ASK = """
const validator = require("gltf-validator");
const fs = require("fs");
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))
  .then((report) => console.log(JSON.stringify(report.issues)));
"""


def sdf_says(file: Path, models: tuple[Path, ...] = ()) -> str:
    """Returns what libsdformat says about an SDF file; ``Valid.`` for a good one. Needs libsdformat.

    Args:
        file: The file.
        models: Folders with the models that it includes.
    """
    ign = need_tool("ign", "ignition-tools libsdformat-dev")
    found = subprocess.run(
        [ign, "sdf", "-k", str(file)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "SDF_PATH": ":".join(map(str, models))},
    )
    said = [line for line in (found.stdout + found.stderr).splitlines() if "backward.so" not in line]
    return "\n".join(said).strip()


def gltf_errors(file: Path) -> list[str]:
    """Returns the errors and warnings that Khronos' validator finds in a GLB; needs node, and npm once."""
    found = subprocess.run(
        ["node", "-e", _ASK, str(file)],
        capture_output=True,
        text=True,
        check=True,
        cwd=_gltf_validator(),
    )
    issues = json.loads(found.stdout)
    assert issues["numErrors"] + issues["numWarnings"] <= len(issues["messages"])
    return [message["message"] for message in issues["messages"] if message["severity"] < 2]


@functools.cache
def _gltf_validator() -> Path:
    """Returns a folder in which the validator is installed."""
    folder = Path(tempfile.gettempdir()) / "simyard-gltf-validator"
    if (folder / "node_modules/gltf-validator").is_dir():
        return folder
    npm = need_tool("npm")
    folder.mkdir(exist_ok=True)
    command = [npm, "install", "--silent", "--no-audit", "--no-fund", "--prefix", str(folder), _NPM_PACKAGE]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        skip_or_fail(f"Khronos' gltf-validator cannot be installed: {done.stderr[-300:]}")
    return folder
