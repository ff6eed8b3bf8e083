"""The base of every document, and the faults that are found in one."""

from pydantic import BaseModel, ConfigDict


class Spec(BaseModel):
    """A frozen document that refuses keys it does not know.

    Fields of documents that RoboMaker defined carry its camelCase names to the letter, in Python too
    (docs/decisions/0002); fields of Simyard's own data are snake_case with the unit as suffix.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="constants")


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
