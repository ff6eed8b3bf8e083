import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from specs.base import canonical_document
from specs.pipeline.document import PipelineSpec, canonical_digest, inert_fields
from specs.template.body import TemplateBody, template_body, template_digest
from tests.factories.strategies import pipelines, shape, template_bodies
from tests.specs.contract_forms import contract, models
from tests.specs.robomaker.test_contract import OPERATIONS

slow = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much]
)
_SIDES = sorted({contract()["operations"][name][side] for name in OPERATIONS for side in ("input", "output")})


@pytest.mark.parametrize("name", _SIDES)
@given(data=st.data())
@settings(slow, max_examples=8)
def test_whatever_the_contract_allows_is_read_and_written_unchanged(name: str, data: st.DataObject):
    document = data.draw(shape(name))

    assert canonical_document(models()[name].model_validate(document)) == document


@given(template_bodies())
@slow
def test_a_template_body_survives_being_written_and_read(document: dict[str, object]):
    body = template_body(document)  # pyright: ignore[reportArgumentType] - JSON by construction

    assert TemplateBody.model_validate(body.model_dump(mode="json")) == body
    assert TemplateBody.model_validate(body.model_dump(mode="json", exclude_none=True)) == body
    assert TemplateBody.model_validate(body.model_dump(mode="json", exclude_unset=True)) == body
    assert TemplateBody.model_validate_json(body.model_dump_json()) == body


@given(template_bodies())
@slow
def test_all_forms_of_a_template_body_mean_the_same(document: dict[str, object]):
    text = json.dumps(document)
    wrapped = [{"name": "Flat", "templateBody": document}, {"name": "Flat", "templateBody": text}, {"name": document}]
    forms = [document, text, *wrapped]

    digests = {template_digest(template_body(form)) for form in forms}  # pyright: ignore[reportArgumentType] - JSON

    assert len(digests) == 1


@given(pipelines())
@slow
def test_a_pipeline_survives_being_written_and_read(document: dict[str, object]):
    spec = PipelineSpec.model_validate(document)

    for written in (
        spec.model_dump(mode="json"),
        spec.model_dump(mode="json", exclude_none=True),
        spec.model_dump(mode="json", exclude_unset=True),
        json.loads(spec.model_dump_json()),
    ):
        again = PipelineSpec.model_validate(written)
        assert again == spec
        assert canonical_digest(again) == canonical_digest(spec)


@given(pipelines())
@slow
def test_fields_without_effect_are_named_once_each(document: dict[str, object]):
    named = inert_fields(PipelineSpec.model_validate(document))

    assert len(named) == len(set(named))
    assert ("worldExport.iamRole" in named) == ("iamRole" in str(document.get("worldExport", {}).keys()))  # pyright: ignore[reportAttributeAccessIssue] - a section
