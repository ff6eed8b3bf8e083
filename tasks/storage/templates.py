"""World templates that somebody named and may change: a record for each, which points at the digest of a body.

A generation job keeps the digest, so an update counts for later jobs only (docs/reference/robomaker.md, section 5). A
template's ARN has its id, which stays when the name changes.

A name is free text, and has one template. Who makes or renames a template first takes the name, then writes the record,
then confirms the name. Whoever finds a name whose template is not there, or is called otherwise, takes it over; the one
who was late finds that out when it confirms. So two templates never have one name, and a process that dies leaves no
name taken.
"""

import hashlib
import logging
import secrets
import time
from collections.abc import Callable, Mapping
from pathlib import PurePosixPath

from pydantic import JsonValue

from specs.arn import absence
from specs.base import Spec, canonical_document, canonical_json
from specs.errors import (
    IdempotentParameterMismatch,
    ObjectCorrupt,
    ObjectExists,
    ObjectNotFound,
    ResourceAlreadyExists,
    ResourceNotFound,
)
from specs.template.body import TemplateBody, template_digest
from tasks.storage.base.keys import (
    NAMED_TEMPLATE_PREFIX,
    named_template_key,
    named_templates_prefix,
    template_key,
    template_name_key,
)
from tasks.storage.base.store import Store, create_once, encode_document, find_document, update

HasName = Callable[[Store, str, str], bool]
"""Tells whether the template with an id is there, and has the name."""
_LOG = logging.getLogger(__name__)
_EARLIER = 100


class _Name(Spec):
    """Who has a name.

    Attributes:
        template: Its id.
        turn: Random, another one each time that the name is taken: who read it before can never write over it.
        confirmed: Whether its record was there, with that name.
    """

    name: str
    template: str
    turn: str
    confirmed: bool = False


def name_holder(store: Store, name: str) -> str:
    """Returns the id of the template that took a name last, whether or not it still has it; empty for none."""
    found = _of_name(store, name)
    return found.template if found else ""


def take_name(store: Store, name: str, template: str, has_name: HasName) -> None:
    """Writes down who wants a name.

    Args:
        store: Where the templates are.
        name: The name; nothing is to be done for an empty one.
        template: Id of the one that wants it.
        has_name: Tells whether another one still has it.

    Raises:
        ResourceAlreadyExists: Another template has it.
    """

    def step(found: _Name | None) -> _Name:
        if found and found.template != template and has_name(store, found.template, name):
            raise name_taken(name)
        return _Name(name=name, template=template, turn=secrets.token_hex(8))

    if name:
        update(store, template_name_key(name), _Name, step)


def confirm_name(store: Store, name: str, template: str) -> bool:
    """Returns whether the name is the template's, whose record is there by now; then nobody takes it over any more."""
    if not name:
        return True

    def step(found: _Name | None) -> _Name | None:
        is_ours = found is not None and found.template == template and not found.confirmed
        return found.model_copy(update={"confirmed": True}) if found and is_ours else found

    found = update(store, template_name_key(name), _Name, step)
    return found is not None and found.template == template


def leave_name(store: Store, name: str, template: str) -> None:
    """Removes the name of a template that has it no more, unless another has taken it over meanwhile."""
    try:
        entry = store.entry(template_name_key(name))
    except ObjectNotFound:
        return
    found = _of_name(store, name)
    if found and found.template == template:
        store.delete_unchanged(entry)


def name_taken(name: str) -> ResourceAlreadyExists:
    """Returns the error that says that another template has a name."""
    return ResourceAlreadyExists.of("name", repr(name), "a name that no world template has")


def _of_name(store: Store, name: str) -> _Name | None:
    return find_document(store, template_name_key(name), _Name)


class NamedTemplate(Spec):
    """A template.

    Attributes:
        id: What its ARN ends in.
        name: Free text, or empty.
        digest: Of its body now.
        version: Of the form of that body, as WorldForge numbers it.
        earlier: Digests of the last hundred bodies that it had before, oldest first, each once.
        token: The clientRequestToken that made it, or empty.
        request_digest: Of the request that came with the token.
    """

    id: str
    name: str
    digest: str
    version: str
    created_at_s: float
    updated_at_s: float
    tags: dict[str, str]
    earlier: tuple[str, ...] = ()
    token: str = ""
    request_digest: str = ""


def keep_body(store: Store, body: TemplateBody) -> str:
    """Returns the digest under which the body lies in the store now."""
    digest = template_digest(body)
    create_once(store, template_key(digest), canonical_json(canonical_document(body)))
    return digest


def read_body(store: Store, digest: str) -> bytes:
    """Returns a body as canonical JSON.

    Raises:
        ResourceNotFound: The store has none of that digest.
    """
    try:
        return store.get(template_key(digest)).body
    except ObjectNotFound as exc:
        raise _missing(store, digest) from exc


def digest_now(store: Store, template: str) -> str:
    """Returns the digest of the body that a template has now; its id may be such a digest itself.

    Raises:
        ResourceNotFound: There is no such template.
    """
    return read_template(store, template).digest if template.startswith(NAMED_TEMPLATE_PREFIX) else template


def create_template(
    store: Store, body: TemplateBody, *, name: str = "", tags: Mapping[str, str] | None = None, token: str = ""
) -> NamedTemplate:
    """Returns a new template, or the one that the same request made before with the same token.

    Args:
        store: Where it is made.
        body: Its body.
        name: Free text; a name has one template, but several may have none.
        tags: Its tags.
        token: The clientRequestToken, or empty.

    Raises:
        ResourceAlreadyExists: Another template has the name.
        IdempotentParameterMismatch: The token came before with another request.
    """
    now_s = time.time()
    digest = keep_body(store, body)
    request: dict[str, JsonValue] = {"name": name, "body": digest, "tags": dict(tags or {})}
    made = NamedTemplate(
        id=_new_id(token),
        name=name,
        digest=digest,
        version=body.Version or "1",
        created_at_s=now_s,
        updated_at_s=now_s,
        tags=dict(tags or {}),
        token=token,
        request_digest=hashlib.sha256(canonical_json(request)).hexdigest() if token else "",
    )
    if token and (before := _found(store, made.id)):
        return _same_request(before, made)
    take_name(store, name, made.id, _has_name)
    try:
        store.create(named_template_key(made.id), encode_document(made))
    except ObjectExists:  # the same token, at the same time
        return _same_request(read_template(store, made.id), made)
    if not confirm_name(store, name, made.id):
        store.delete(named_template_key(made.id))
        raise name_taken(name)
    return made


def update_template(
    store: Store, template: str, *, body: TemplateBody | None = None, name: str | None = None
) -> NamedTemplate:
    """Returns a template after its body, its name or both were changed; None leaves one as it is.

    Args:
        store: Where it is.
        template: Its id.
        body: What later jobs make worlds of.
        name: What it is called from now on.

    Raises:
        ResourceNotFound: There is no such template.
        ResourceAlreadyExists: Another template has the name.
    """
    digest = keep_body(store, body) if body else ""
    before = read_template(store, template)
    renamed = name is not None and name != before.name
    if renamed:
        take_name(store, name or "", template, _has_name)

    def step(found: NamedTemplate) -> NamedTemplate:
        changes: dict[str, object] = {"updated_at_s": max(time.time(), found.updated_at_s)}
        if body and digest != found.digest:
            earlier = tuple(dict.fromkeys((*found.earlier, found.digest)))[-_EARLIER:]
            changes |= {"digest": digest, "version": body.Version or "1", "earlier": earlier}
        return found.model_copy(update=changes if name is None else {**changes, "name": name})

    after = change_template(store, template, step)
    if renamed:
        if not confirm_name(store, after.name, template):
            change_template(store, template, lambda found: found.model_copy(update={"name": before.name}))
            raise name_taken(after.name)
        leave_name(store, before.name, template)
    return after


def change_template(store: Store, template: str, step: Callable[[NamedTemplate], NamedTemplate]) -> NamedTemplate:
    """Returns a template after a change, written over exactly what was read.

    Args:
        store: Where it is.
        template: Its id.
        step: Returns what it shall be; called again when another process was first.

    Raises:
        ResourceNotFound: There is no such template.
    """
    return update(
        store, named_template_key(template), NamedTemplate, lambda found: step(_present(found, store, template))
    )


def delete_template(store: Store, template: str) -> None:
    """Removes a template; its bodies stay, because worlds were made of them.

    Raises:
        ResourceNotFound: There is no such template.
    """
    found = read_template(store, template)
    store.delete(named_template_key(template))
    leave_name(store, found.name, template)


def read_template(store: Store, template: str) -> NamedTemplate:
    """Returns a template, by its id.

    Raises:
        ResourceNotFound: There is no such template.
    """
    return _present(_found(store, template), store, template)


def find_template_name(store: Store, name: str) -> NamedTemplate | None:
    """Returns the template that has a name, or None."""
    holder = name_holder(store, name)
    found = _found(store, holder) if holder else None
    return found if found and found.name == name else None


def named_templates(store: Store) -> list[NamedTemplate]:
    """Returns all templates that somebody named, oldest first; one with a damaged record is left out, and logged."""
    ids = [PurePosixPath(key).stem for key in store.keys(named_templates_prefix())]
    found = [each for template in ids if (each := _listed(store, template))]
    return sorted(found, key=lambda each: (each.created_at_s, each.id))


def _listed(store: Store, template: str) -> NamedTemplate | None:
    try:
        return _found(store, template)
    except ObjectCorrupt as exc:
        _LOG.warning("the template %s is left out of lists: %s", template, exc)
        return None


def template_count(store: Store) -> int:
    """Returns how many templates somebody named, without reading them."""
    return len(store.keys(named_templates_prefix()))


def is_made(store: Store, *, name: str, token: str) -> bool:
    """Returns whether a token or a name has a template already, so that `create_template` would make no new one."""
    of_token = bool(token) and _found(store, _new_id(token)) is not None
    return of_token or (bool(name) and find_template_name(store, name) is not None)


def _new_id(token: str) -> str:
    digits = hashlib.sha256(f"world-template|{token}".encode()).hexdigest()[:16] if token else secrets.token_hex(8)
    return f"{NAMED_TEMPLATE_PREFIX}{digits}"


def _same_request(before: NamedTemplate, now: NamedTemplate) -> NamedTemplate:
    if before.request_digest != now.request_digest:
        allowed = f"came before with another request ({before.id}); send the same one, or another token"
        raise IdempotentParameterMismatch.of("clientRequestToken", repr(now.token), allowed)
    return before


def _has_name(store: Store, template: str, name: str) -> bool:
    found = _found(store, template)
    return found is not None and found.name == name


def _found(store: Store, template: str) -> NamedTemplate | None:
    return find_document(store, named_template_key(template), NamedTemplate)


def _present(found: NamedTemplate | None, store: Store, template: str) -> NamedTemplate:
    if found is None:
        raise _missing(store, template)
    return found


def _missing(store: Store, template: str) -> ResourceNotFound:
    return ResourceNotFound.of("template", repr(template), absence(["world-template"], store.url))
