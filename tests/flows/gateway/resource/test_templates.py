"""Calls about world templates."""

import json
from typing import Any

import pytest

from specs.errors import (
    DocumentError,
    IdempotentParameterMismatch,
    LimitExceeded,
    ResourceAlreadyExists,
    ResourceNotFound,
)
from specs.template.body import TemplateBody
from tasks.storage.buckets import open_bucket
from tasks.storage.templates import keep_body
from tests.flows.gateway.jobs.asked import Asked
from tests.worlds.templates import SAMPLES

SMALL, WIDE = (path.read_text() for path in SAMPLES[:2])


def create(gateway: Asked, **more: Any) -> dict[str, Any]:  # noqa: ANN401 - RoboMaker's
    return gateway.call("CreateWorldTemplate", **{"templateBody": SMALL, **more})


def body_of(gateway: Asked, template: str) -> TemplateBody:
    text = gateway.call("GetWorldTemplateBody", template=template)["templateBody"]
    return TemplateBody.model_validate(json.loads(text))


def test_a_template_is_described_as_it_was_asked_for(gateway: Asked) -> None:
    made = create(gateway, name="a small flat", tags={"team": "arms"}, clientRequestToken="t")
    described = gateway.call("DescribeWorldTemplate", template=made["arn"])
    assert {name: described[name] for name in made} == made
    assert described["lastUpdatedAt"] == described["createdAt"]
    assert (described["name"], described["tags"], described["version"]) == ("a small flat", {"team": "arms"}, "1")
    assert body_of(gateway, made["arn"]) == TemplateBody.model_validate(SMALL)


def test_a_body_may_lie_in_a_bucket(gateway: Asked) -> None:
    open_bucket(gateway.store, "shapes").put("flat.json", SMALL.encode())
    place = {"s3Bucket": "shapes", "s3Key": "flat.json"}
    made = gateway.call("CreateWorldTemplate", templateLocation=place)
    assert body_of(gateway, made["arn"]) == TemplateBody.model_validate(SMALL)
    with pytest.raises(ResourceNotFound, match="none is there"):
        gateway.call("CreateWorldTemplate", templateLocation={**place, "s3Key": "other.json"})
    open_bucket(gateway.store, "shapes").put("big.json", b" " * (1 << 21))
    with pytest.raises(DocumentError, match="templateLocation"):
        gateway.call("CreateWorldTemplate", templateLocation={**place, "s3Key": "big.json"})


@pytest.mark.parametrize(
    "members", [{}, {"templateBody": SMALL, "templateLocation": {"s3Bucket": "abc", "s3Key": "k"}}]
)
def test_a_body_is_given_once(gateway: Asked, members: dict[str, Any]) -> None:
    with pytest.raises(DocumentError, match=r"templateBody|templateLocation"):
        gateway.call("CreateWorldTemplate", **members)


def test_an_update_changes_body_or_name_and_keeps_the_arn(gateway: Asked) -> None:
    made = create(gateway, name="flat")
    changed = gateway.call("UpdateWorldTemplate", template=made["arn"], templateBody=WIDE)
    assert (changed["arn"], changed["name"]) == (made["arn"], "flat")
    assert changed["lastUpdatedAt"] > changed["createdAt"]
    assert body_of(gateway, made["arn"]) == TemplateBody.model_validate(WIDE)
    assert gateway.call("UpdateWorldTemplate", template=made["arn"], name="house")["name"] == "house"
    with pytest.raises(DocumentError, match="nothing to change"):
        gateway.call("UpdateWorldTemplate", template=made["arn"])


def test_a_job_has_the_body_that_it_began_with(gateway: Asked) -> None:
    made = create(gateway)
    job = gateway.call("CreateWorldGenerationJob", template=made["arn"], worldCount={"floorplanCount": 1})["arn"]
    gateway.call("UpdateWorldTemplate", template=made["arn"], templateBody=WIDE)
    text = gateway.call("GetWorldTemplateBody", generationJob=job)["templateBody"]
    assert TemplateBody.model_validate(json.loads(text)) == TemplateBody.model_validate(SMALL)
    gateway.call("DeleteWorldTemplate", template=made["arn"])
    assert gateway.call("GetWorldTemplateBody", generationJob=job)["templateBody"] == text


def test_a_body_is_asked_of_a_template_or_of_a_job(gateway: Asked) -> None:
    with pytest.raises(DocumentError, match="template or generationJob"):
        gateway.call("GetWorldTemplateBody")
    template, job = gateway.arn("world-template", "wt-1"), gateway.arn("world-generation-job", "wgj-1")
    with pytest.raises(DocumentError, match="template or generationJob"):
        gateway.call("GetWorldTemplateBody", template=template, generationJob=job)
    for members in ({"template": template}, {"generationJob": job}):
        with pytest.raises(ResourceNotFound):
            gateway.call("GetWorldTemplateBody", **members)


def test_a_token_makes_one_template_also_when_there_is_no_room(gateway: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_TEMPLATES", "1")
    made = create(gateway, clientRequestToken="t", name="flat")
    assert create(gateway, clientRequestToken="t", name="flat") == made
    with pytest.raises(IdempotentParameterMismatch):
        create(gateway, clientRequestToken="t", name="house")
    with pytest.raises(ResourceAlreadyExists):
        create(gateway, name="flat")
    with pytest.raises(LimitExceeded, match="SIMYARD_MAX_TEMPLATES"):
        create(gateway)


def test_a_deleted_template_is_gone(gateway: Asked) -> None:
    template = create(gateway)["arn"]
    assert gateway.call("DeleteWorldTemplate", template=template) == {}
    for call in ("DescribeWorldTemplate", "GetWorldTemplateBody", "DeleteWorldTemplate", "UpdateWorldTemplate"):
        with pytest.raises(ResourceNotFound):
            gateway.call(call, template=template)


def test_a_body_that_documents_used_is_read_and_never_changed(gateway: Asked) -> None:
    digest = keep_body(gateway.store, TemplateBody.model_validate(SMALL))
    template = gateway.arn("world-template", digest)
    assert gateway.call("DescribeWorldTemplate", template=template)["name"] == digest
    assert body_of(gateway, template) == TemplateBody.model_validate(SMALL)
    for call in ("DeleteWorldTemplate", "UpdateWorldTemplate"):
        with pytest.raises(ResourceNotFound, match="CreateWorldTemplate"):
            gateway.call(call, template=template)
