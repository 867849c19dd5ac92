"""Answers that several routes share, and their examples for /docs."""

from typing import Any

from fastapi import Response

from server.state import encode

REFUSED_EXAMPLE = {"detail": "the e-stop is latched; POST /api/v1/estop/clear first"}
INVALID_EXAMPLE = {
    "detail": [
        {
            "field": "force_n[2]",
            "msg": "force_n[2] is outside the allowed range; allowed: -40 to 40 N",
            "allowed": "-40 to 40 N",
        }
    ],
}
DEAD_EXAMPLE = {"detail": "the control process is dead (exit code -9); POST /api/v1/control/restart starts a fresh one"}


def json_response(value: Any, status_code: int = 200) -> Response:
    """JSON where what is not finite is null."""
    return Response(encode(value), status_code=status_code, media_type="application/json")


def _described(description: str, example: Any) -> dict[str, Any]:
    return {"description": description, "content": {"application/json": {"example": example}}}


def answers(example: Any, *, status: int = 200, description: str = "Done", refusable: bool = True) -> dict[int | str, Any]:
    """OpenAPI responses of a call: its answer by example and the errors that it shares with the others.

    Args:
        example: of the answer.
        status: of the answer.
        description: of the answer.
        refusable: whether the call can be refused or needs the control process.
    """
    responses: dict[int | str, Any] = {status: _described(description, example)}
    if refusable:
        responses[409] = _described("The state forbids it; the message says what to do", REFUSED_EXAMPLE)
        responses[413] = _described("The body is too large", {"detail": "the body is too large; allowed: 16 KiB"})
        responses[422] = _described("A field is not allowed; nothing changed", INVALID_EXAMPLE)
        responses[503] = _described("No control process runs", DEAD_EXAMPLE)
    return responses
