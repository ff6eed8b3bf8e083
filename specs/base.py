"""The base of every document, and the faults that are found in one."""

from functools import cache
from typing import Self

from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from specs.form_schema import as_form

_set_attribute = object.__setattr__  # what `model_construct` sets attributes of frozen documents with


@cache
def _all_names(model: type[BaseModel]) -> set[str]:
    """Returns the names of all fields; documents share the set, for nobody adds to that of a frozen one."""
    return set(model.model_fields)


class Spec(BaseModel):
    """A frozen document that refuses keys it does not know.

    Fields of documents that RoboMaker defined carry its camelCase names to the letter, in Python too
    (docs/decisions/0002); fields of Simyard's own data are snake_case with the unit as suffix.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="constants")

    @classmethod
    def unchecked(cls, fields: dict[str, object]) -> Self:
        """Returns a document of fields that its own code made right: all of them, of their very types.

        A check of each would take several times as long as all the rest. Data from outside goes through
        ``model_validate``. The dictionary becomes the document's own.
        """
        document = cls.__new__(cls)
        _set_attribute(document, "__dict__", fields)
        _set_attribute(document, "__pydantic_fields_set__", _all_names(cls))
        _set_attribute(document, "__pydantic_extra__", None)
        _set_attribute(document, "__pydantic_private__", None)
        return document

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Returns the schema with everything that a form in the browser shows of each field."""
        schema = handler(core_schema)
        as_form(handler.resolve_ref_schema(schema), cls, cls.model_fields)
        return schema


class Fault(Spec):
    """One thing wrong with a document.

    Attributes:
        path: Where, from the top of the document, such as ``worldGeneration.worldCount.floorplanCount``.
        value: What stands there, shortened for printing.
        allowed: What may stand there instead.
    """

    path: str
    value: str
    allowed: str

    def __str__(self) -> str:
        """Returns the fault as one line for a person."""
        return f"{self.path}: {self.value}: {self.allowed}"
