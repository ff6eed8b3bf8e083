"""Templates that somebody named."""

from threading import Barrier, Thread

import pytest

from specs.errors import IdempotentParameterMismatch, ResourceAlreadyExists, ResourceNotFound
from specs.template.body import TemplateBody, template_digest
from tasks.storage.base.keys import named_template_key, template_name_key
from tasks.storage.base.store import Store
from tasks.storage.templates import (
    NamedTemplate,
    confirm_name,
    create_template,
    delete_template,
    find_template_name,
    named_templates,
    read_body,
    read_template,
    take_name,
    update_template,
)
from tests.worlds.templates import SAMPLES, sample

SMALL, WIDE = (sample(path.name.removesuffix(".body.json")) for path in SAMPLES[:2])


def test_a_template_points_at_its_body(store: Store) -> None:
    made = create_template(store, SMALL, name="a small flat", tags={"team": "arms"})
    assert read_template(store, made.id) == made
    assert TemplateBody.model_validate_json(read_body(store, made.digest)) == SMALL
    assert find_template_name(store, "a small flat") == made


def test_an_update_leaves_the_body_that_jobs_know_where_it_is(file_store: Store) -> None:
    made = create_template(file_store, SMALL)
    after = update_template(file_store, made.id, body=WIDE)
    assert (after.digest, after.earlier) == (template_digest(WIDE), (template_digest(SMALL),))
    assert after.updated_at_s > after.created_at_s == made.created_at_s
    assert TemplateBody.model_validate_json(read_body(file_store, made.digest)) == SMALL


def test_the_same_token_and_request_make_one_template(file_store: Store) -> None:
    made = create_template(file_store, SMALL, name="flat", token="t")  # noqa: S106 - no secret
    assert create_template(file_store, SMALL, name="flat", token="t") == made  # noqa: S106 - no secret
    with pytest.raises(IdempotentParameterMismatch, match=made.id):
        create_template(file_store, WIDE, name="flat", token="t")  # noqa: S106 - no secret


def test_a_name_has_one_template(file_store: Store) -> None:
    made = create_template(file_store, SMALL, name="flat")
    with pytest.raises(ResourceAlreadyExists, match="'flat'"):
        create_template(file_store, WIDE, name="flat")
    assert named_templates(file_store) == [made]


def test_several_templates_may_have_no_name(file_store: Store) -> None:
    assert create_template(file_store, SMALL).id != create_template(file_store, SMALL).id
    assert len(named_templates(file_store)) == 2


def test_a_renamed_template_gives_its_old_name_back(file_store: Store) -> None:
    made = create_template(file_store, SMALL, name="flat")
    assert update_template(file_store, made.id, name="house").name == "house"
    assert find_template_name(file_store, "flat") is None
    other = create_template(file_store, SMALL, name="flat")
    with pytest.raises(ResourceAlreadyExists):
        update_template(file_store, other.id, name="house")
    assert read_template(file_store, other.id).name == "flat"


def test_a_deleted_template_gives_its_name_back(file_store: Store) -> None:
    made = create_template(file_store, SMALL, name="flat")
    delete_template(file_store, made.id)
    with pytest.raises(ResourceNotFound):
        read_template(file_store, made.id)
    assert not file_store.exists(template_name_key("flat"))
    with pytest.raises(ResourceNotFound):
        delete_template(file_store, made.id)


def test_the_name_of_a_process_that_died_is_taken_over(file_store: Store) -> None:
    take_name(file_store, "flat", "wt-dead", lambda *_: False)
    made = create_template(file_store, SMALL, name="flat")
    assert find_template_name(file_store, "flat") == made
    assert not confirm_name(file_store, "flat", "wt-dead")


def test_who_is_late_with_its_record_learns_that_the_name_is_gone(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    create = file_store.create
    others: list[NamedTemplate] = []

    def slow(key: str, body: bytes) -> str:
        if key.startswith("world-templates/") and not others:
            monkeypatch.undo()
            others.append(create_template(file_store, WIDE, name="flat"))
        return create(key, body)

    monkeypatch.setattr(file_store, "create", slow)
    with pytest.raises(ResourceAlreadyExists):
        create_template(file_store, SMALL, name="flat")
    assert named_templates(file_store) == others


def test_of_many_that_want_a_name_at_once_one_gets_it(file_store: Store) -> None:
    start, made = Barrier(8), list[NamedTemplate]()

    def one() -> None:
        start.wait()
        try:
            made.append(create_template(file_store, SMALL, name="flat"))
        except ResourceAlreadyExists:
            return

    threads = [Thread(target=one) for _ in range(8)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert [each for each in named_templates(file_store) if each.name == "flat"] == made
    assert len(made) == 1
    assert file_store.exists(named_template_key(made[0].id))
