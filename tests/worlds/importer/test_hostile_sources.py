"""Sources that mean harm or are broken: each gets its message, and a bounded amount of work."""

from pathlib import Path

import pytest

from specs.base import Fault
from tasks.worlds.importer import sdf_reader, source_files
from tasks.worlds.importer.import_process import read_mesh
from tasks.worlds.importer.sdf_reader import read_sdf
from tasks.worlds.importer.source_scene import SourceError
from tests.worlds.importer.sources import BOX, collision, findings, model, scene, shared_model, world


def faults(path: Path) -> tuple[Fault, ...]:
    with pytest.raises(SourceError) as caught:
        read_sdf(path)
    return caught.value.faults


def refusal(folder: Path, inside: str) -> str:
    return "; ".join(f"{each.path}: {each.value}: {each.allowed}" for each in faults(world(folder, inside)))


@pytest.mark.parametrize(
    "doctype",
    ["<!DOCTYPE sdf [<!ENTITY a 'aaaa'>]>", "<!DOCTYPE sdf SYSTEM 'file:///etc/passwd'>"],
    ids=["own", "other"],
)
def test_entities_and_other_document_types_are_refused(tmp_path: Path, doctype: str):
    path = tmp_path / "w.world"
    path.write_text(f"<?xml version='1.0'?>{doctype}<sdf version='1.6'><world name='w'/></sdf>")
    (fault,) = faults(path)
    assert (fault.path, fault.value) == ("w.world line 1", "a document type")


@pytest.mark.parametrize("text", ["", "a: b", "<sdf", "<robot name='r'/>", "<sdf version='1.9'/>"])
def test_what_is_no_world_is_refused(tmp_path: Path, text: str):
    path = tmp_path / "w.world"
    path.write_text(text)
    assert faults(path)[0].path == "w.world"


@pytest.mark.parametrize("version", ["", "1.3", "1.12", "2.0", "x"])
def test_versions_that_nobody_knows_are_refused(tmp_path: Path, version: str):
    assert "SDF 1.4 to 1.11" in "".join(each.allowed for each in faults(world(tmp_path, model("m"), version)))


def test_a_model_that_includes_itself_is_refused(tmp_path: Path):
    for one, other in (("a", "b"), ("b", "a")):
        shared_model(tmp_path / "models", one, model(one, f"<include><uri>model://{other}</uri></include>"))
    assert "a/model.sdf -> b/model.sdf -> a/model.sdf" in refusal(tmp_path, "<include><uri>model://a</uri></include>")


def test_models_that_include_ever_more_of_them_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("tasks.worlds.importer.sdf_reader._MOST_MODELS", 200)
    for k in range(12):
        more = f"<include><uri>model://m{k + 1}</uri></include>" * 8
        shared_model(tmp_path / "models", f"m{k}", model("m", more))
    assert "at most 200 models" in refusal(tmp_path, "<include><uri>model://m0</uri></include>")


def test_more_includes_than_any_world_has_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(source_files, "MOST_ELEMENTS", 200)
    assert "at most 200 in all files" in refusal(tmp_path, "<include><uri>model://a</uri></include>" * 500)


def test_elements_in_each_other_without_end_are_refused(tmp_path: Path):
    assert "at most 100 elements inside each other" in refusal(tmp_path, "<model name='m'>" * 5_000)


@pytest.mark.parametrize(
    "address", ["../../secret", "model://../secret", "file:///../../secret", "model://a/../../secret"]
)
def test_addresses_that_climb_out_are_refused(tmp_path: Path, address: str):
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "model.sdf").write_text(f"<sdf version='1.6'>{model('m')}</sdf>")
    assert "a path without .." in refusal(tmp_path / "in" / "worlds", f"<include><uri>{address}</uri></include>")


def test_links_that_lead_out_are_refused(tmp_path: Path):
    shared_model(tmp_path / "elsewhere", "secret", model("m"))
    (tmp_path / "in" / "models").mkdir(parents=True)
    (tmp_path / "in" / "models" / "chair").symlink_to(tmp_path / "elsewhere" / "secret")
    assert "a link leads out of them" in refusal(tmp_path / "in", "<include><uri>model://chair</uri></include>")


def test_an_absolute_path_elsewhere_is_not_read(tmp_path: Path):
    found = scene(tmp_path, model("m") + "<include><uri>file:///etc/passwd</uri></include>")
    assert len(findings(found, "unresolved")) == 1
    assert list(found.files) == ["w.world"]


@pytest.mark.parametrize("size", ["nan 1 1", "1 1", "-1 1 1", "0 1 1", "1 1 1e12", "inf 1 1", "a b c", "1 1 1 1"])
def test_sizes_that_are_none_are_refused(tmp_path: Path, size: str):
    said = refusal(tmp_path, model("m", collision(f"<box><size>{size}</size></box>")))
    assert said == f"w.world line 1: size: {size}: 3 numbers above 0, each at most 1,000,000,000"


def test_all_faults_come_at_once(tmp_path: Path):
    bad = model("a", f"<pose>nan 0 0 0 0 0</pose>{collision(BOX)}") + model(
        "b", collision("<box><size>-1 1 1</size></box>")
    )
    hills = model("c", collision("<heightmap><uri>h.png</uri></heightmap>"))
    frame = model("d", f"<pose relative_to='nowhere'>0 0 0 0 0 0</pose>{collision(BOX)}")
    found = faults(world(tmp_path, bad + hills + frame))
    assert sorted(each.value for each in found) == ["-1 1 1", "heightmap", "nan 0 0 0 0 0", "nowhere"]


def test_frames_that_are_relative_to_each_other_are_refused(tmp_path: Path):
    frames = "<frame name='a' attached_to='b'/><frame name='b' attached_to='a'/>"
    said = refusal(tmp_path, frames + model("m", f"<pose relative_to='a'>0 0 0 0 0 0</pose>{collision(BOX)}"))
    assert "a -> b -> a" in said


def test_a_mesh_that_is_none_is_told_and_the_rest_imported(tmp_path: Path):
    (tmp_path / "t.stl").write_bytes(b"\0" * 80 + (10**9).to_bytes(4, "little"))
    (tmp_path / "u.dae").write_text("<!DOCTYPE a [<!ENTITY b 'c'>]><COLLADA/>")
    (tmp_path / "v.dae").write_text("<COLLADA><scene><instance_visual_scene url='#none'/></scene></COLLADA>")
    broken = "".join(model(name, collision(f"<mesh><uri>{name}</uri></mesh>")) for name in ("t.stl", "v.dae"))
    said = findings(scene(tmp_path, model("m") + broken), "unresolved")
    assert len(said) == 2
    assert "t.stl has no triangles" in said[0]
    assert "refers to '#none', which is not there" in said[1]
    with pytest.raises(SourceError, match="a document type"):
        scene(tmp_path, model("m", collision("<mesh><uri>u.dae</uri></mesh>")))


def test_a_mesh_with_corners_that_are_no_numbers_is_told(tmp_path: Path):
    (tmp_path / "t.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 1\nf 1 2 3\n")
    said = findings(scene(tmp_path, model("m") + model("t", collision("<mesh><uri>t.obj</uri></mesh>"))), "unresolved")
    assert "corners that are no numbers" in said[0]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.glb", b"glTF\2\0\0\0\xff\xff\xff\x7f"),
        ("a.txt", b""),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 999999999\nend_header\n"),
    ],
)
def test_files_that_are_no_mesh_are_refused(tmp_path: Path, name: str, text: bytes):
    (tmp_path / name).write_bytes(text)
    with pytest.raises(SourceError, match=r"a mesh: \.dae, \.glb"):
        read_mesh(tmp_path / name)


def test_a_scan_without_triangles_is_refused_with_what_to_make_of_it(tmp_path: Path):
    corner = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n1 0 1\n1 1 2\n"
    (tmp_path / "scan.ply").write_text(f"ply\nformat ascii 1.0\n{corner}")
    with pytest.raises(SourceError, match=r"has no triangles: a mesh: .*; of a scan, make a mesh of its points"):
        read_mesh(tmp_path / "scan.ply")


def test_a_file_larger_than_any_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(source_files, "_MOST_FILE_BYTES", 100)
    assert "MiB" in refusal(tmp_path, model("m"))


def test_what_stands_beyond_the_horizon_is_left_out(tmp_path: Path):
    found = scene(tmp_path, model("m") + model("far", f"<pose>0 0 343582 0 0 0</pose>{collision(BOX)}"))
    assert findings(found, "dropped") == ["far/link/c: stands 343,582 m from the origin; 10,000 m are the most"]


def test_the_reader_s_own_limits_are_far_above_any_world():
    assert sdf_reader._MOST_MODELS >= 10_000
