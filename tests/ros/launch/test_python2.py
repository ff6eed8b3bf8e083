"""Python 2 in nodes' programs is named with its line, and what may be for both is not."""

from pathlib import Path

import pytest

from tasks.ros.launch.python2 import imported_modules, python2_sentences

REMEDY = "2to3 -w rewrites Python 2"


def told(folder: Path, text: str, first: str = "#!/usr/bin/env python\n") -> list[str]:
    (folder / "node").write_text(first + text)
    return python2_sentences(folder / "node", "pkg/node")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("from itertools import count, izip\n", "line 2: Python 3 has no itertools.izip"),
        ("import rospy\nimport Queue as queue\n", "line 3: Python 3 has no module Queue"),
        ("from urlparse import urljoin\n", "line 2: Python 3 has no module urlparse"),
        ("for k in xrange(3):\n    pass\n", "line 2: Python 3 has no xrange"),
    ],
)
def test_what_is_gone_is_named(tmp_path: Path, text: str, words: str) -> None:
    assert told(tmp_path, text) == [f"pkg/node, {words}: {REMEDY}"]


def test_syntax_of_python_2_is_named(tmp_path: Path) -> None:
    (found,) = told(tmp_path, "import rospy\nprint 'hello'\n")
    assert found.startswith("pkg/node, line 3: no Python 3: Missing parentheses in call to 'print'")


@pytest.mark.parametrize(
    "text",
    [
        "try:\n    import Queue\nexcept ImportError:\n    import queue as Queue\n",
        "try:\n    xrange\nexcept NameError:\n    xrange = range\nxrange(3)\n",
        "import sys\nif sys.version_info[0] < 3:\n    import Queue\nelse:\n    import queue as Queue\n",
        "from six.moves import xrange\nxrange(3)\n",
        "from six.moves import *\nxrange(3)\n",
        "from .Queue import x\n",
        "print('hello')\n",
        "x = '\0'\n",
    ],
)
def test_what_runs_with_python_3_or_may_is_not(tmp_path: Path, text: str) -> None:
    assert told(tmp_path, text) == []


def test_programs_of_other_kinds_are_not_read(tmp_path: Path) -> None:
    assert told(tmp_path, "echo 'hello' print x\n", first="#!/bin/sh\n") == []
    assert python2_sentences(tmp_path / "none", "pkg/none") == []


def test_what_a_program_imports_is_told_with_its_line_but_what_it_only_tries(tmp_path: Path) -> None:
    tried = "try:\n    import d_msgs\nexcept OSError:\n    pass\n"
    text = f"import os, a_msgs.msg\nfrom b_msgs.srv import X\nfrom .c_msgs import Y\n{tried}"
    (tmp_path / "node.py").write_text(text)
    assert imported_modules(tmp_path / "node.py") == [(1, "a_msgs"), (1, "os"), (2, "b_msgs")]
    assert imported_modules(tmp_path / "none.py") == []
