"""The fields of a schema of an OpenAPI description, flat and in words, for `/docs`."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

Json = dict[str, Any]

_KINDS = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false", "null": "null"}
_FEW = 10
"""Choices that are listed where they stand."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field: `path` such as `contacts[].wheel`, `kind` such as "3 numbers or null", and its manual."""

    path: str
    kind: str
    text: str
    required: bool


def resolved(description: Json, schema: Json) -> Json:
    """The object's schema behind a reference or an optional one; the schema itself where there is none."""
    options = schema.get("anyOf", [schema])
    reference = next((option["$ref"] for option in options if "$ref" in option), None)
    return schema if reference is None else description["components"]["schemas"][reference.rsplit("/", 1)[1]]


def fields_of(description: Json, schema: Json, prefix: str = "") -> Iterator[Field]:
    """Fields of an object or of the objects of a list, each followed by its own."""
    if schema.get("type") == "array":
        yield from fields_of(description, schema["items"], f"{prefix}[]")
        return
    model = resolved(description, schema)
    for name, field in model.get("properties", {}).items():
        path = f"{prefix}.{name}" if prefix else name
        text = field.get("description") or resolved(description, field).get("description", "")
        kind = _kind(field)
        yield Field(path, "" if text.startswith(kind) else kind, text, name in model.get("required", []))
        yield from fields_of(description, field, path)


def _kind(schema: Json) -> str:
    if "anyOf" in schema:
        return " or ".join(map(_kind, schema["anyOf"]))
    if "const" in schema or len(schema.get("enum", "")) in range(1, _FEW):
        return " | ".join(map(str, schema.get("enum", [schema.get("const")])))
    if "$ref" in schema:
        return "object"
    if schema["type"] == "array":
        size = schema.get("minItems")
        return f"{'list' if size is None else size} of {_kind(schema['items'])}"
    if schema["type"] == "object":
        return f"{_kind(schema['additionalProperties'])}, by name"
    return _KINDS[schema["type"]]
