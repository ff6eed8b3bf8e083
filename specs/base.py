"""The base of every document, and the faults that are found in one."""

from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from specs.form_schema import as_form


class Spec(BaseModel):
    """A frozen document that refuses keys it does not know.

    Fields of documents that RoboMaker defined carry its camelCase names to the letter, in Python too
    (docs/decisions/0002); fields of Simyard's own data are snake_case with the unit as suffix.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="constants")

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
