"""Every citation and every link in this repository leads somewhere.

A citation is a path from the root: ``docs/reference/robomaker.md``, with ``section 8`` or ``sections 3 and 4`` after a
comma where the page numbers its headings, or ``docs/decisions/0008`` for a decision.
"""

import ast
import re
import subprocess
from collections import Counter
from collections.abc import Callable
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
# In a docstring or a comment: a name of this code, its words joined by underscores, perhaps of a module.
_NAME = re.compile(r"``((?:[a-z_]+\.)*[a-z]+(?:_[a-z]+)+)``")
_PACKAGES = ("specs", "tasks", "flows", "simyard")
_FOREIGN = frozenset(["cdds_request_header_t", "rmw_init_cs"])  # of rmw_cyclonedds_cpp
_ELSEWHERE = re.compile(
    r"\bsemantics,? \d|\bthe semantics\b|\btraps? \d|\bdecisions? \d|\bdesign notes\b|\.\./shared\b"
)


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


def pages_not_there(text: str) -> list[str]:
    return [
        found.group()
        for found in _PAGE.finditer(_LINE_END.sub(" ", text))
        if not _exists(found.group().partition(",")[0])
    ]


def sections_not_there(text: str) -> list[str]:
    missing: list[str] = []
    for found in _PAGE.finditer(_LINE_END.sub(" ", text)):
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
    prose = _LINE_END.sub(" ", _LINK.sub("", text) if path.suffix == ".md" else text)
    neighbours = {page.name for page in (*ROOT.glob("*.md"), *(ROOT / path).parent.glob("*.md"))}
    bare = [name for name in _BARE_PAGE.findall(prose) if name not in neighbours]
    return [*_ELSEWHERE.findall(prose), *bare]


@cache
def names() -> frozenset[str]:
    """Every word of the code besides docstrings and comments, and every module."""
    found: set[str] = set()
    for path, text in files().items():
        if path.suffix == ".py":
            tree = ast.parse(text)
            docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
            found.update(path.with_suffix("").parts)
            found.update(word for node in ast.walk(tree) if id(node) not in docstrings for word in _words(node))
    return frozenset(found)


def _words(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Constant):
        return re.findall(r"\w+", node.value) if isinstance(node.value, str) else []
    values = (getattr(node, field, None) for field in ("name", "id", "attr", "arg", "module"))
    return [word for value in values if isinstance(value, str) for word in value.split(".")]


def names_not_there(text: str) -> list[str]:
    cited = (name.split(".") for name in _NAME.findall(text))
    return [".".join(parts) for parts in cited if parts[0] in names() and not names().issuperset(parts)] + [
        name for name in _NAME.findall(text) if "." not in name and name not in names() | _FOREIGN
    ]


def _exists(cited: str) -> bool:
    folder, _, name = cited.rpartition("/")
    if folder == "docs/decisions" and name.isdigit():
        return len(list((ROOT / folder).glob(f"{name}-*.md"))) == 1
    return (ROOT / cited).exists()


def _has_section(page: Path, number: str) -> bool:
    return any(heading.startswith(f"{number}. ") for heading in headings(page))


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


def test_every_name_that_the_source_cites_is_one_of_the_code():
    assert faults(lambda path, text: names_not_there(text) if path.parts[0] in _PACKAGES else []) == {}


def test_a_name_that_is_not_there_is_found():
    assert names_not_there("as ``flows.no_such_thing`` and ``nor_this`` say, not ``twist_map``") == [
        "flows.no_such_thing",
        "nor_this",
    ]


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
