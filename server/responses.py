"""Answers that routes share, and the refusals that OpenAPI tells of."""

from typing import Any

from fastapi import Response

from server.answers.refusals import InvalidAnswer, RefusalAnswer
from server.answers.schema import EXAMPLES
from server.state import encode

_MEANING = {
    400: "The request is malformed",
    401: "The token is missing or wrong",
    403: "The request comes from a foreign page or for a foreign host name",
    404: "What the path names does not exist",
    409: "The state forbids it; the message says what to do",
    413: "The body is too large",
    422: "A field is not allowed; nothing changed",
    429: "Too many calls, at once or per second",
    500: "A defect; the console's log tells more",
    503: "No control process runs, or it does not answer",
}


def json_response(value: Any, status_code: int = 200) -> Response:
    """JSON where what is not finite is null."""
    return Response(encode(value), status_code=status_code, media_type="application/json")


def refusals(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """OpenAPI responses of a call that may be refused with these statuses."""
    return {status: _refusal(status) for status in statuses}


def _refusal(status: int) -> dict[str, Any]:
    response: dict[str, Any] = {
        "model": InvalidAnswer if status == 422 else RefusalAnswer,
        "description": _MEANING[status],
    }
    if str(status) in EXAMPLES:
        response["content"] = {"application/json": {"example": EXAMPLES[str(status)]}}
    return response


ANY_CALL = refusals(400, 401, 403, 429, 500)
"""What every call may answer."""
