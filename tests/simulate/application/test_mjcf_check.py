"""A robot's MJCF is checked before MuJoCo reads it: it names nothing outside its bundle, and does not explode."""

import os
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.simulate.application.mjcf_check import MjcfRefused, check_mjcf
from tasks.simulate.application.robot_file import read_robot_mjcf
from tests.repository import ROOT


def robot(folder: Path, inner: str = "", body: str = "") -> Path:
    path = folder / "robot.xml"
    path.write_text(f"<mujoco>{inner}<worldbody><body>{body}</body></worldbody></mujoco>")
    return path


@pytest.mark.parametrize("name", ["courier", "wanderer"])
def test_the_robots_that_come_with_simyard_are_let_through(name: str):
    check_mjcf(ROOT / "applications" / name / "robot.xml")


_PATHS = [
    "../b.xml",
    "/etc/passwd",
    "a/../../b.xml",
    "..",
    "C:/x.xml",
    "file:///etc/passwd",
    "a\\b.xml",
    "a\u202eb.xml",
]
_NAMING = [
    '<include file="{}"/>',
    '<asset><mesh name="m" file="{}"/></asset>',
    '<asset><texture name="t" type="2d" file="{}"/></asset>',
    '<asset><texture name="t" type="cube" fileup="{}"/></asset>',
    '<asset><hfield name="h" file="{}"/></asset>',
    '<asset><skin name="s" file="{}"/></asset>',
    '<asset><model name="s" file="{}"/></asset>',
    '<deformable><skin name="s" file="{}"/></deformable>',
    '<compiler meshdir="{}"/>',
    '<compiler assetdir="{}"/>',
    '<compiler texturedir="{}"/>',
    '<worldbody><flexcomp name="f" file="{}"/></worldbody>',
]


@pytest.mark.parametrize(
    ("inner", "path"), [*((each, _PATHS[0]) for each in _NAMING), *((_NAMING[0], each) for each in _PATHS)]
)
def test_what_lies_outside_the_bundle_cannot_be_named(tmp_path: Path, inner: str, path: str):
    with pytest.raises(MjcfRefused, match="must be a path inside the bundle"):
        check_mjcf(robot(tmp_path, inner.format(path)))


@pytest.mark.parametrize(
    "inner",
    [
        '<option timestep="1e-300"/>',
        '<option timestep="nan"/>',
        '<option gravity="0 0 -inf"/>',
        '<option gravity="0 0 1e300"/>',
        '<option gravity="0 0 0x1p2000"/>',
        '<option iterations="2000000000"/>',
        '<size memory="1E"/>',
        '<size memory="99999999999"/>',
        '<size njmax="2000000000"/>',
        '<size nconmax="2000000000"/>',
        '<size nuserdata="2000000000"/>',
        '<custom><numeric name="n" size="500000000" data="1"/></custom>',
        '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>',
        '<asset><texture name="t" type="2d" builtin="flat" width="60000" height="60000"/></asset>',
        '<asset><mesh name="m" builtin="supersphere" params="100000 1 1"/></asset>',
        '<compiler><lengthrange timestep="1e-5" inttotal="1e9"/></compiler>',
        '<extension><plugin plugin="mujoco.elasticity.cable"/></extension>',
        '<sensor><user dim="1000000000"/></sensor>',
    ],
)
def test_an_absurd_value_is_refused_with_its_place(tmp_path: Path, inner: str):
    with pytest.raises(MjcfRefused, match=r"robot\.xml line 1: \w+: "):
        check_mjcf(robot(tmp_path, inner))


@pytest.mark.parametrize(
    "body",
    [
        '<replicate count="100000000" offset="1 0 0"><geom size="1"/></replicate>',
        '<replicate count="1e8" offset="1 0 0"><geom size="1"/></replicate>',
        '<replicate count="300"><replicate count="300"><geom size="1"/></replicate></replicate>',
        '<replicate count="20">' * 12 + '<geom size="1"/>' + "</replicate>" * 12,
        '<replicate count="4000"><geom size="1"/><site/></replicate>',
        '<composite type="cable" count="100000 1 1" size="1"/>',
        '<flexcomp name="f" type="grid" count="1000 1000 1000"/>',
        '<replicate count="60"><flexcomp name="f" type="grid" count="5 5 5"/></replicate>',
        "<body>" * 300 + "</body>" * 300,
        "<site/>" * 30_000,
    ],
    ids=range(10),
)
def test_a_model_that_explodes_is_refused(tmp_path: Path, body: str):
    with pytest.raises(MjcfRefused, match="elements"):
        check_mjcf(robot(tmp_path, body=body))


def test_models_that_attach_each_other_do_not_explode(tmp_path: Path):
    for number in range(12):
        attach = '<attach model="m" body="b" prefix="p"/>' * 8
        asset = f'<asset><model name="m" file="{number + 1}.xml"/></asset>'
        text = f'<mujoco>{asset}<worldbody><body name="b">{attach}</body></worldbody></mujoco>'
        (tmp_path / f"{number}.xml").write_text(text)
    robot(tmp_path).rename(tmp_path / "12.xml")
    with pytest.raises(MjcfRefused, match="more than 5,000 elements"):
        check_mjcf(tmp_path / "0.xml")


def test_a_model_that_attaches_itself_is_refused(tmp_path: Path):
    with pytest.raises(MjcfRefused, match="attaches itself"):
        check_mjcf(robot(tmp_path, '<asset><model name="m" file="robot.xml"/></asset>'))


def test_what_is_included_is_checked_too(tmp_path: Path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/leg.xml").write_text('<mujocoinclude><mesh name="m" file="../../x.stl"/></mujocoinclude>')
    with pytest.raises(MjcfRefused, match=r"parts/leg\.xml line 1: mesh: file"):
        check_mjcf(robot(tmp_path, '<asset><include file="parts/leg.xml"/></asset>'))


def test_files_that_include_each_other_end(tmp_path: Path):
    (tmp_path / "a.xml").write_text('<mujocoinclude><include file="robot.xml"/><include file="a.xml"/></mujocoinclude>')
    check_mjcf(robot(tmp_path, '<include file="a.xml"/>'))


def test_what_is_included_in_a_replicate_counts_as_often(tmp_path: Path):
    (tmp_path / "a.xml").write_text('<mujocoinclude><replicate count="99"><site/></replicate></mujocoinclude>')
    with pytest.raises(MjcfRefused, match="more than 5,000 elements"):
        check_mjcf(robot(tmp_path, body='<replicate count="99"><include file="a.xml"/></replicate>'))


def test_a_link_in_a_bundle_is_refused(tmp_path: Path):
    (tmp_path / "mesh.stl").symlink_to("/etc/passwd")
    with pytest.raises(MjcfRefused, match=r"'mesh\.stl': a link in the bundle"):
        check_mjcf(robot(tmp_path, '<asset><mesh name="m" file="mesh.stl"/></asset>'))


def test_a_picture_that_decodes_to_gigabytes_is_refused(tmp_path: Path):
    (tmp_path / "t.png").write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00\x00\x0dIHDR" + struct.pack(">II", 65_535, 65_535))
    with pytest.raises(MjcfRefused, match="points in all"):
        check_mjcf(robot(tmp_path, '<asset><texture name="t" type="2d" file="t.png"/></asset>'))


@pytest.mark.parametrize(
    "text",
    [
        '<!DOCTYPE m [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><mujoco model="&b;"/>',
        '<!DOCTYPE m SYSTEM "file:///etc/passwd"><mujoco/>',
        '<?xml version="1.0" encoding="utf-16"?><mujoco/>',
        "<mujoco>",
        "",
        "\x00",
        '<robot name="urdf"/>',
    ],
    ids=range(7),
)
def test_what_is_no_plain_mjcf_is_refused(tmp_path: Path, text: str):
    (tmp_path / "robot.xml").write_text(text)
    with pytest.raises(MjcfRefused, match=r"robot\.xml"):
        check_mjcf(tmp_path / "robot.xml")


def test_a_robot_that_is_refused_never_gets_to_mujoco(tmp_path: Path):
    with pytest.raises(MjcfRefused, match="count"):
        read_robot_mjcf(robot(tmp_path, body='<replicate count="one"><geom size="1"/></replicate>'))


_NAMES = ["file", "count", "timestep", "name", "size", "memory", "params", "nrow", "ncol", "model"]
_VALUES = ["robot.xml", "../robot.xml", "1e8 1e8", "nan", "1G", "-5", "", "a.xml", "1e999"]
_LETTERS = st.characters(exclude_categories=["Cs", "Cc"])
_TEXTS = st.one_of(st.sampled_from(_VALUES), st.text(_LETTERS, max_size=8))
_ATTRIBUTES = st.dictionaries(st.sampled_from(_NAMES), _TEXTS, max_size=3)
_SHAPES = ["composite", "flexcomp", "mesh", "hfield", "geom", "option", "size", "body"]
_TAGS = st.sampled_from(["include", "replicate", "model", "attach", *_SHAPES])


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")


def _element(tag: str, attributes: dict[str, str], children: list[str]) -> str:
    written = "".join(f' {name}="{_escaped(text)}"' for name, text in attributes.items())
    return f"<{tag}{written}>{''.join(children)}</{tag}>"


def _with_children(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.builds(_element, _TAGS, _ATTRIBUTES, st.lists(inner, max_size=4))


_LEAF = st.builds(_element, _TAGS, _ATTRIBUTES, st.just(list[str]()))
_ELEMENTS = st.recursive(_LEAF, _with_children, max_leaves=12)


@given(_ELEMENTS, _ELEMENTS)
def test_whatever_a_file_holds_it_is_let_through_or_refused(
    tmp_path_factory: pytest.TempPathFactory, inner: str, included: str
):
    folder = tmp_path_factory.getbasetemp() / f"mjcf-{os.getpid()}"
    folder.mkdir(exist_ok=True)
    (folder / "a.xml").write_text(f"<mujocoinclude>{included}</mujocoinclude>")
    (folder / "robot.xml").write_text(f"<mujoco>{inner}</mujoco>")
    said = ""
    try:
        check_mjcf(folder / "robot.xml")
    except MjcfRefused as refused:
        said = str(refused)
    assert len(said) < 500
    assert said.isprintable()


@given(st.binary(max_size=200))
def test_whatever_bytes_a_file_holds_it_is_refused_unless_it_is_mjcf(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
):
    folder = tmp_path_factory.getbasetemp() / f"bytes-{os.getpid()}"
    folder.mkdir(exist_ok=True)
    (folder / "robot.xml").write_bytes(content)
    with pytest.raises(MjcfRefused):
        check_mjcf(folder / "robot.xml")
