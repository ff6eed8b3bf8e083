"""Names of world templates: free text, and a name has one template.

Who makes or renames a template first takes the name, then writes the record, then confirms the name. Whoever finds a
name whose template is not there, or is called otherwise, takes it over; the one who was late finds that out when it
confirms. So two templates never have one name, and a process that dies leaves no name taken.
"""

import secrets
from collections.abc import Callable

from specs.base import Fault, Spec
from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound, ResourceAlreadyExists
from tasks.storage.base.encoding import decode_document, encode_document
from tasks.storage.base.keys import template_name_key
from tasks.storage.base.store import Store, StoredObject

HasName = Callable[[Store, str, str], bool]
"""Tells whether the template with an id is there, and has the name."""


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
    found = _read(store, name)
    return found[0].template if found else ""


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
    while name:
        try:
            store.create(template_name_key(name), _wanted(name, template))
        except ObjectExists:
            if not _take_over(store, name, template, has_name):
                continue
        return


def confirm_name(store: Store, name: str, template: str) -> bool:
    """Returns whether the name is the template's, whose record is there by now; then nobody takes it over any more."""
    while name:
        found = _read(store, name)
        if found is None or found[0].template != template:
            return False
        if found[0].confirmed:
            return True
        try:
            confirmed = found[0].model_copy(update={"confirmed": True})
            store.replace(template_name_key(name), encode_document(confirmed), found[1].etag)
        except ObjectConflict:
            continue
        return True
    return True


def leave_name(store: Store, name: str, template: str) -> None:
    """Removes the name of a template that has it no more, unless another has taken it over meanwhile."""
    try:
        entry = store.entry(template_name_key(name))
    except ObjectNotFound:
        return
    found = _read(store, name)
    if found and found[0].template == template:
        store.delete_unchanged(entry)


def name_taken(name: str) -> ResourceAlreadyExists:
    """Returns the error that says that another template has a name."""
    return ResourceAlreadyExists([Fault(path="name", value=repr(name), allowed="a name that no world template has")])


def _take_over(store: Store, name: str, template: str, has_name: HasName) -> bool:
    """Returns whether a name that was written down is this template's now; False to try again."""
    found = _read(store, name)
    if found is None:
        return False
    if found[0].template != template and has_name(store, found[0].template, name):
        raise name_taken(name)
    try:
        store.replace(template_name_key(name), _wanted(name, template), found[1].etag)
    except ObjectConflict:
        return False
    return True


def _wanted(name: str, template: str) -> bytes:
    return encode_document(_Name(name=name, template=template, turn=secrets.token_hex(8)))


def _read(store: Store, name: str) -> tuple[_Name, StoredObject] | None:
    key = template_name_key(name)
    try:
        stored = store.get(key)
    except ObjectNotFound:
        return None
    return decode_document(_Name, stored, store, key), stored
