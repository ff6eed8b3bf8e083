from pathlib import Path

import pytest

from specs.errors import DocumentError
from tasks.documents.pipeline_file import names_a_file, read_pipeline
from tests.repository import ROOT

DOCUMENT = """
name: nightly
worldGeneration: {template: templates/flat.json, worldCount: {floorplanCount: 2}}
"""


def written(folder: Path, document: str, template: str | None = '{"Version": "1"}') -> Path:
    (folder / "templates").mkdir()
    if template is not None:
        (folder / "templates" / "flat.json").write_text(template)
    (folder / "pipeline.yaml").write_text(document)
    return folder / "pipeline.yaml"


def faults(path: Path) -> list[tuple[str, str, str]]:
    with pytest.raises(DocumentError) as caught:
        read_pipeline(path)
    return [(fault.path, fault.value, fault.allowed) for fault in caught.value.faults]


def test_paths_in_the_document_stay_as_they_stand(tmp_path: Path):
    spec = read_pipeline(written(tmp_path, DOCUMENT))

    assert spec.worldGeneration is not None
    assert spec.worldGeneration.template == "templates/flat.json"


def test_a_missing_template_is_told_once_with_its_path(tmp_path: Path):
    assert faults(written(tmp_path, DOCUMENT, template=None)) == [
        (
            "worldGeneration.template",
            "templates/flat.json: there is no such file",
            "a YAML or JSON document of at most 1 MiB",
        )
    ]


def test_faults_of_the_template_are_told_beside_those_of_the_document(tmp_path: Path):
    path = written(tmp_path, DOCUMENT.replace("nightly", "my night"), '{"Version": "3"}')

    assert [fault[:2] for fault in faults(path)] == [
        ("name", '"my night"'),
        ("worldGeneration.template", 'templates/flat.json: Version: "3"'),
    ]


def test_a_template_file_without_content_is_refused(tmp_path: Path):
    assert faults(written(tmp_path, DOCUMENT.replace(".json", ".yaml"), template=None))


def test_a_source_that_is_no_folder_is_refused(tmp_path: Path):
    path = written(tmp_path, DOCUMENT + "applications: [{name: courier, source: nowhere}]")

    assert [fault[:2] for fault in faults(path)] == [("applications[0].source", "nowhere")]


@pytest.mark.parametrize("template", ["templates/flat.json", "flat.json", "../flat"])
def test_a_template_with_a_folder_or_a_suffix_is_a_file(template: str):
    assert names_a_file(template)


@pytest.mark.parametrize("template", ["flat", "s3://b/flat.json", "arn:simyard:world-template:s1:flat", '{"a": 1.0}'])
def test_a_name_a_url_an_arn_and_a_body_are_no_file(template: str):
    assert not names_a_file(template)


def test_the_example_is_valid():
    assert read_pipeline(ROOT / "examples" / "quickstart.yaml").name == "apartment-regression"


@pytest.mark.parametrize("key", ["Buildings", "buildings", "Rooms", "templateBody"])
def test_a_template_alone_is_told_what_makes_worlds_of_it(tmp_path: Path, key: str):
    file = tmp_path / "home.yaml"
    file.write_text(f"{key}: []\n")

    with pytest.raises(DocumentError) as caught:
        read_pipeline(file)

    (fault,) = caught.value.faults
    assert fault.value == "a template alone"
    assert "worldGeneration: {template: home.yaml" in fault.allowed


def test_a_document_with_a_section_is_never_taken_for_a_template(tmp_path: Path):
    file = tmp_path / "home.yaml"
    file.write_text("name: a\nworldGeneration: {}\nVersion: 1\n")

    with pytest.raises(DocumentError) as caught:
        read_pipeline(file)

    assert {fault.path for fault in caught.value.faults} >= {"Version", "worldGeneration.worldCount"}
