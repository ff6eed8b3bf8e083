"""Every citation and every link in this repository leads somewhere.

A citation is a path from the root: ``docs/reference/robomaker.md``, with ``section 8`` or ``sections 3 and 4`` after a
comma where the page numbers its headings, or ``docs/decisions/0008`` for a decision.
"""

import ast
import re
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# A citation may go on in the next line of a comment.
_LINE_END = re.compile(r"[ \t]*\n[ \t]*(?:#[ \t]?)?")
_PAGE = re.compile(r"(?<![\w./-])docs/[\w./-]*\w(?P<numbers>, sections? \d+(?:(?:, | and )\d+)*)?")
_HEADING = re.compile(r"^#{1,6} (.+?) *$", re.MULTILINE)
_NUMBER = re.compile(r"\d+")
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"`[^`\n]*`")
_LINK = re.compile(r"!?\[(?P<words>[^\]]*)\]\((?P<target>[^)\s]+)\)")
_BARE_PAGE = re.compile(r"(?<![\w./\"'-])[a-z][\w-]*\.md\b")
_ELSEWHERE = re.compile(
    r"\bsemantics,? \d|\bthe semantics\b|\btraps? \d|\bdecisions? \d|\bdesign notes\b|\.\./shared\b"
)

# A name as code has it: with an underscore, and not part of a path, a pattern or a command.
_NAME = re.compile(r"(?<![\w./:<{$%-])_?[A-Za-z][A-Za-z0-9]*(?:_[A-Za-z0-9]+)+(?![\w>}]|-\w|://)")
_WORD = re.compile(r"\w+")
_PRODUCT = ("specs", "tasks", "flows", "simyard")
# What other programs and standards call something.
_NAMES_OF_OTHERS = {
    *(
        "MINARI_DATASETS_PATH",
        "MUJOCO_LOG",
        "mju_makeFrame",
        "nav2_map_server",
        "PARENT_PID",
        "proc_pid_stat",
    ),
    "PR_SET_DUMPABLE",
    "load_config_default",
    *("PREFECT_LOGGING_EXTRA_LOGGERS", "PREFECT_LOGGING_LEVEL", "robot_description", "snake_case", "Sofas_1_seat"),
    *("stroke_width", "USER_DATA", "user_namespaces", "cdds_request_header_t", "rmw_init_cs"),
}


@cache
def files() -> dict[Path, str]:
    """Every text file that git knows or would add, relative to the root, but for this one, which has wrong examples."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    here = Path(__file__).relative_to(ROOT)
    texts: dict[Path, str] = {}
    for path in map(Path, filter(None, listed.stdout.split("\0"))):
        if path == here or not (ROOT / path).is_file():
            continue
        try:
            texts[path] = (ROOT / path).read_text()
        except UnicodeDecodeError:  # a picture
            continue
    return texts


@cache
def headings(page: Path) -> tuple[str, ...]:
    return tuple(_HEADING.findall(_FENCE.sub("", page.read_text())))


@cache
def anchors(page: Path) -> frozenset[str]:
    """The names that GitHub gives to the page's headings; the second of a name ends in -1."""
    plain = (_LINK.sub(r"\g<words>", heading).lower() for heading in headings(page))
    names: Counter[str] = Counter()
    found: set[str] = set()
    for name in (re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain):
        found.add(f"{name}-{names[name]}" if names[name] else name)
        names[name] += 1
    return frozenset(found)


@cache
def in_one_line(text: str) -> str:
    """Returns a text of which every comment is one line."""
    return _LINE_END.sub(" ", text)


def pages_not_there(text: str) -> list[str]:
    return [
        found.group() for found in _PAGE.finditer(in_one_line(text)) if not _exists(found.group().partition(",")[0])
    ]


def sections_not_there(text: str) -> list[str]:
    missing: list[str] = []
    for found in _PAGE.finditer(in_one_line(text)):
        page = ROOT / found.group().partition(",")[0]
        numbers = _NUMBER.findall(found["numbers"] or "")
        if page.is_file() and not all(_has_section(page, number) for number in numbers):
            missing.append(found.group())
    return missing


def links_to_nowhere(text: str, page: Path) -> list[str]:
    prose = _CODE.sub("", _FENCE.sub("", text))
    targets = (found["target"] for found in _LINK.finditer(prose))
    return [target for target in targets if "://" not in target and not _leads_somewhere(target, page)]


def citations_of_elsewhere(text: str, path: Path) -> list[str]:
    prose = in_one_line(_LINK.sub("", text) if path.suffix == ".md" else text)
    neighbours = {page.name for page in (*ROOT.glob("*.md"), *(ROOT / path).parent.glob("*.md"))}
    bare = [name for name in _BARE_PAGE.findall(prose) if name not in neighbours]
    return [*_ELSEWHERE.findall(prose), *bare]


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Yields the statements of a module, those within others as well; not what each is made of."""
    yield node
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
            yield from statements(child)


@cache
def prose_and_code(text: str) -> tuple[str, frozenset[str]]:
    """A module's comments and docstrings, and the words of its code, those in texts as well."""
    holders = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    documented = [node for node in statements(ast.parse(text)) if isinstance(node, holders) and ast.get_docstring(node)]
    docstrings = {
        number for node in documented for number in range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1)
    }
    prose, code = list[str](), set[str]()
    for number, line in enumerate(text.split("\n"), 1):
        code_of_line, _, comment = ("", "", line) if number in docstrings else line.partition("# ")
        prose.append(comment)
        code.update(_WORD.findall(code_of_line))
    return "\n".join(prose), frozenset(code)


@cache
def known_names() -> frozenset[str]:
    """Every word that code, a file that is no page, or a name of a file has."""
    known: set[str] = set()
    for path, text in files().items():
        known.update((path.stem, *path.parts))
        if _is_of_product(path):
            known |= prose_and_code(text)[1]
        elif path.suffix != ".md":
            known.update(_WORD.findall(text))
    return frozenset(name.lstrip("_") for name in known) | _NAMES_OF_OTHERS


def names_not_there(text: str) -> list[str]:
    return sorted({name for name in _NAME.findall(prose_and_code(text)[0]) if name.lstrip("_") not in known_names()})


def _exists(cited: str) -> bool:
    folder, _, name = cited.rpartition("/")
    if folder == "docs/decisions" and name.isdigit():
        return len(list((ROOT / folder).glob(f"{name}-*.md"))) == 1
    return (ROOT / cited).exists()


def _has_section(page: Path, number: str) -> bool:
    return any(heading.startswith(f"{number}. ") for heading in headings(page))


def _is_of_product(path: Path) -> bool:
    return path.suffix == ".py" and path.parts[0] in _PRODUCT


def _leads_somewhere(target: str, page: Path) -> bool:
    path, _, anchor = target.partition("#")
    aim = ROOT / page.parent / path if path else ROOT / page
    return aim.exists() and (not anchor or anchor in anchors(aim))


def faults(find: Callable[[Path, str], list[str]]) -> dict[str, list[str]]:
    """What ``find`` finds in each file that is not right."""
    found = {str(path): find(path, text) for path, text in files().items()}
    return {path: wrong for path, wrong in found.items() if wrong}


def test_every_cited_page_is_there():
    assert faults(lambda _, text: pages_not_there(text)) == {}


def test_every_cited_section_is_a_heading_of_its_page():
    assert faults(lambda _, text: sections_not_there(text)) == {}


def test_every_link_of_a_page_leads_somewhere():
    assert faults(lambda path, text: links_to_nowhere(text, path) if path.suffix == ".md" else []) == {}


def test_nothing_is_cited_that_is_not_in_this_repository():
    assert faults(lambda path, text: citations_of_elsewhere(text, path)) == {}


def test_every_name_in_a_comment_or_docstring_is_one_that_the_code_has():
    of_product = faults(lambda path, text: names_not_there(text) if _is_of_product(path) else [])
    assert of_product == {}


@pytest.mark.parametrize(
    "text",
    ['"""As in ``nobody_has_this``."""', "# see NOBODY_HAS_THIS there", 'def f():\n    """Of (nobody_has_it)."""'],
)
def test_a_name_that_no_code_has_is_found(text: str):
    assert len(names_not_there(text)) == 1


@pytest.mark.parametrize(
    "text",
    [
        "(docs/reference/nothing.md, section 1)",
        "see docs/decisions/0000",
        "`make soak --document docs/nothing.md`",
        "DOCUMENT = (ROOT / 'docs/nothing.md').read_text()",
    ],
)
def test_a_page_that_is_not_there_is_found(text: str):
    assert len(pages_not_there(text)) == 1


@pytest.mark.parametrize(
    "text",
    [
        "(docs/reference/robomaker.md, section 99)",
        "(docs/reference/robomaker.md, sections 3 and 99)",
        "# as docs/reference/robomaker.md,\n    # section 99, says",
        "docs/reference/robomaker.md, sections 3,\n99 and 4",
    ],
)
def test_a_section_that_is_not_there_is_found(text: str):
    assert len(sections_not_there(text)) == 1


@pytest.mark.parametrize(
    "link", ["nothing.md", "robomaker.md#99-nothing", "#nothing", "../nothing/", "../../README.md#nothing"]
)
def test_a_link_to_nowhere_is_found(link: str):
    assert links_to_nowhere(f"A [link]({link}).", Path("docs/reference/store.md")) == [link]


@pytest.mark.parametrize(
    "text",
    [
        "semantics 8",
        "(semantics 3 and 4)",
        "RoboMaker semantics 2",
        "no rule of the semantics",
        "(physics.md)",
        "(fleet.md, section 6)",
        "docs/reference/store.md, trap 6",
        "told by (store,\n# trap 6)",
        "decision 8",
        "../shared/design",
    ],
)
def test_a_citation_of_what_is_elsewhere_is_found(text: str):
    assert len(citations_of_elsewhere(text, Path("tasks/storage/s3.py"))) == 1


@pytest.mark.parametrize(
    "text",
    [
        "(docs/reference/robomaker.md, section 8)",
        "# docs/reference/robomaker.md, sections 3, 4\n# and 8: so",
        "docs/decisions/0008.",
        "docs/decisions/0008-restart.md",
        "the README.md of a bundle",
        "(SVG 1.1, section 3.2)",
    ],
)
def test_a_citation_that_leads_somewhere_is_no_fault(text: str):
    path = Path("tasks/storage/s3.py")
    assert [*pages_not_there(text), *sections_not_there(text), *citations_of_elsewhere(text, path)] == []
