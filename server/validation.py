"""Errors of request validation in the one form that every 422 has: field, problem, allowed range."""

from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import ValidationError

from server.errors import InvalidFieldError
from server.fields import RequestModel


def invalid_fields(errors: Iterable[Mapping[str, Any]]) -> list[InvalidFieldError]:
    """One error per pydantic error. Never echoes the input, which may be NaN."""
    return [_invalid_field(error) for error in errors]


def _invalid_field(error: Mapping[str, Any]) -> InvalidFieldError:
    context = error.get("ctx", {})
    path = [part for part in error["loc"] if part not in ("body", "query", "path")]
    if "field" in context:
        path.append(context["field"])
    if "index" in context:
        path.append(context["index"])
    field = ""
    for part in path:
        field += f"[{part}]" if isinstance(part, int) else f"{'.' if field else ''}{part}"
    problem, allowed = _explain(error["type"], context, error["msg"])
    return InvalidFieldError(field or "body", problem, allowed)


def _explain(kind: str, context: Mapping[str, Any], message: str) -> tuple[str, str]:
    match kind:
        case "extra_forbidden":
            return "is unknown", "the fields in /docs"
        case "missing":
            return "is missing", "it is required"
        case "literal_error":
            return "is no valid choice", str(context["expected"])
        case "bool_type":
            return "must be a boolean", "true or false"
        case "too_long":
            return "has too many entries", f"at most {context['max_length']}"
        case "string_too_long":
            return "is too long", f"at most {context['max_length']} characters"
        case "json_invalid":
            return f"is no valid JSON ({context['error']})", "a JSON object"
        case _:
            return message, str(context.get("allowed", "see /docs"))


def validated(model: type[RequestModel], fields: Mapping[str, Any]) -> dict[str, Any]:
    """The given fields, checked by a request model.

    Raises:
        InvalidFieldError: names the first field that is not allowed.
    """
    try:
        return model.model_validate(dict(fields)).model_dump(exclude_unset=True)
    except ValidationError as error:
        raise invalid_fields(error.errors())[0] from None
