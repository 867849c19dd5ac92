"""What the schemas of answers are made of.

A schema is a typed dictionary: the routes build plain dictionaries, which costs nothing at 100 Hz, pyright holds them against
the schemas, and the tests hold real answers against them. The docstring under a field is its manual: unit, frame, meaning.
SI units; "heading" is the frame of control.frames; forces are those of the environment on the robot. What is not available
or not finite is null.
"""

import json
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, GetCoreSchemaHandler, TypeAdapter, with_config
from pydantic_core import CoreSchema, core_schema
from typing_extensions import TypedDict, get_original_bases

from control.joints import JOINT_COUNT

EXAMPLES: dict[str, Any] = json.loads(Path(__file__).with_name("examples.json").read_text(encoding="utf-8"))
"""A recorded answer by the name of its schema or, of refusals, by status; `tests/server/record_examples.py` records them."""

Vector2 = Annotated[list[float], Field(min_length=2, max_length=2)]
Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[float], Field(min_length=4, max_length=4)]
Mask = Annotated[list[Literal[0, 1]], Field(min_length=3, max_length=3)]
PerJoint = Annotated[list[float | None], Field(min_length=JOINT_COUNT, max_length=JOINT_COUNT)]


@dataclass(frozen=True, slots=True)
class OneOf:
    """Annotation of a text that is one of some names."""

    names: tuple[str, ...]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.literal_schema(list(self.names))


def names_of(enum: type[IntEnum]) -> OneOf:
    """The members of an enumeration as REST spells them, in lower case."""
    return OneOf(tuple(member.name.lower() for member in enum))


def _complete(schema: dict[str, Any], answer: type[Any]) -> None:
    """Adds the recorded example, and the manual of fields of a base, which pydantic leaves out."""
    if answer.__name__ in EXAMPLES:
        schema["examples"] = [EXAMPLES[answer.__name__]]
    for base in get_original_bases(answer):
        if base not in (Answer, TypedDict):
            for name, field in TypeAdapter(base).json_schema()["properties"].items():
                schema["properties"][name].setdefault("description", field["description"])


@with_config(ConfigDict(use_attribute_docstrings=True, json_schema_extra=_complete))
class Answer(TypedDict):
    """An object in an answer."""
