import json
from pathlib import Path

import pytest
from pydantic import JsonValue

from specs.errors import DocumentError, ResourceNotFound
from specs.template.body import TemplateBody, template_body
from tasks.documents.template_source import find_template
from tasks.storage.base.keys import template_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.templates import create_template, update_template

BODY: JsonValue = {"Buildings": [{"Floors": [{"Floorplan": {"Ceiling": {"Height": 3.5}}}]}]}
EXPECTED = template_body(BODY)


def test_a_body_is_its_own_template(file_store: Store, tmp_path: Path):
    assert find_template(EXPECTED, file_store, tmp_path) is EXPECTED


@pytest.mark.parametrize("wrapped", [BODY, {"name": "Flat", "templateBody": BODY}])
def test_a_path_is_found_from_the_documents_folder(file_store: Store, tmp_path: Path, wrapped: object):
    (tmp_path / "flat.json").write_text(json.dumps(wrapped))

    assert find_template("flat.json", file_store, tmp_path) == EXPECTED


@pytest.mark.parametrize("reference", ["flat", "arn:simyard:world-template:any:flat"])
def test_a_name_or_an_arn_is_found_in_the_store(file_store: Store, tmp_path: Path, reference: str):
    file_store.create(template_key("flat"), json.dumps(BODY).encode())

    assert find_template(reference, file_store, tmp_path) == EXPECTED


def test_a_url_is_found_in_its_bucket(file_store: Store, tmp_path: Path):
    open_bucket(file_store, "shapes").put("flats/flat.json", json.dumps(BODY).encode())

    assert find_template("s3://shapes/flats/flat.json", file_store, tmp_path) == EXPECTED


@pytest.mark.parametrize(
    "reference", ["flat", "flat.json", "s3://shapes/flat.json", "arn:simyard:world-template:any:flat"]
)
def test_a_template_that_is_nowhere_is_told_by_its_place_in_the_document(
    file_store: Store, tmp_path: Path, reference: str
):
    with pytest.raises(ResourceNotFound) as caught:
        find_template(reference, file_store, tmp_path)

    assert [fault.path for fault in caught.value.faults] == ["worldGeneration.template"]


def test_a_file_that_is_no_template_is_refused(file_store: Store, tmp_path: Path):
    (tmp_path / "flat.yaml").write_text("Version: 1")

    with pytest.raises(DocumentError, match="in quotes"):
        find_template("flat.yaml", file_store, tmp_path)


def test_a_template_of_version_2_is_told_from_one_of_version_1(file_store: Store, tmp_path: Path):
    (tmp_path / "flat.yaml").write_text('Version: "2"')

    assert find_template("flat.yaml", file_store, tmp_path) == TemplateBody(Version="2")


def test_a_template_that_somebody_named_is_found_by_name_by_id_and_by_arn(file_store: Store, tmp_path: Path):
    named = create_template(file_store, EXPECTED, name="a flat with 1.5 baths")

    for reference in ("a flat with 1.5 baths", named.id, f"arn:simyard:world-template:any:{named.id}"):
        assert find_template(reference, file_store, tmp_path) == EXPECTED


def test_a_changed_template_is_found_as_it_is_now(file_store: Store, tmp_path: Path):
    other = template_body({"Buildings": [{"Floors": [{"Floorplan": {"Ceiling": {"Height": 2.5}}}]}]})
    named = create_template(file_store, EXPECTED, name="flat")
    update_template(file_store, named.id, body=other)

    assert find_template("flat", file_store, tmp_path) == other


def test_a_path_wins_over_a_template_of_that_name(file_store: Store, tmp_path: Path):
    create_template(file_store, template_body({"Buildings": [{"Floors": [{}]}]}), name="flat.json")
    (tmp_path / "flat.json").write_text(json.dumps(BODY))

    assert find_template("flat.json", file_store, tmp_path) == EXPECTED


SECRETS = {
    "passwd": "root:x:0:0:the secret:/root:/bin/bash\n",
    "config.json": '{"auths": {"registry.example": {"auth": "the secret"}}}',
    "hosts.yml": "github.com:\n  oauth_token: the secret\n",
    "compose.yml": 'version: "3"\nservices: {db: {environment: {PASSWORD: the secret}}}\n',
    "list.yaml": "- the secret\n",
    "text.json": '"{\\"key\\": \\"the secret\\"}"',
    "named.json": '{"name": {"key": "the secret"}}',
}


@pytest.mark.parametrize("name", SECRETS)
def test_no_word_is_repeated_of_a_file_that_has_nothing_of_a_template(file_store: Store, tmp_path: Path, name: str):
    (tmp_path / name).write_text(SECRETS[name])
    open_bucket(file_store, "theirs").put(name, SECRETS[name].encode())
    for place in (str(tmp_path / name), f"s3://theirs/{name}"):
        with pytest.raises(DocumentError, match="a template body, which has Buildings") as caught:
            find_template(place, file_store, Path("/"))
        assert "secret" not in str(caught.value)
        assert [fault.path for fault in caught.value.faults] == ["file"]


def test_what_is_wrong_in_a_template_is_still_shown(file_store: Store, tmp_path: Path):
    for body in ({"buildings": "one"}, {"templateBody": {"Buildings": "one"}}, json.dumps({"Buildings": "one"})):
        (tmp_path / "flat.json").write_text(json.dumps(body))
        with pytest.raises(DocumentError, match="one"):
            find_template("flat.json", file_store, tmp_path)
