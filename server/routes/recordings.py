"""Recordings: every tick's sensors, inputs and estimates, snapshots, transforms and arrows, as MCAP files."""

from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Path, Response
from fastapi.responses import FileResponse

from server.answers.recordings import EstimatesAnswer, EstimatesCreatedAnswer, RecordingAnswer
from server.dependencies import TheOperator
from server.responses import json_response, refusals
from server.schemas import EstimatesRequest, RecordingRequest
from sim.recording.folder import RecordingRow

router = APIRouter(prefix="/api/v1/recordings", tags=["recordings"])

RecordingId = Annotated[str, Path(min_length=1, max_length=64, examples=["20261128-231500-000-push"])]

_FILE: dict[int | str, dict[str, Any]] = {200: {"content": {"application/octet-stream": {}}, "description": "The file"}}


@router.get("", response_model=list[RecordingAnswer])
def list_recordings(operator: TheOperator) -> Response:
    """All, newest first; the one under way is not complete."""
    return json_response([_answer(row) for row in operator.recordings.list()])


@router.post("", status_code=201, response_model=RecordingAnswer, responses=refusals(409, 413, 422, 503))
def start_recording(operator: TheOperator, body: RecordingRequest | None = None) -> Response:
    """Record from the next tick on, until it is ended, the control process ends, or the disk budget is used up."""
    body = body or RecordingRequest()
    return json_response(_answer(operator.recordings.start(body.name, body.note)), 201)


@router.delete("/current", response_model=RecordingAnswer, responses=refusals(404, 409, 503))
def stop_recording(operator: TheOperator) -> Response:
    """End the recording under way; answers when its file is whole."""
    return json_response(_answer(operator.recordings.stop()))


@router.get("/{recording_id}", response_model=RecordingAnswer, responses=refusals(404, 422))
def get_recording(recording_id: RecordingId, operator: TheOperator) -> Response:
    """One."""
    return json_response(_answer(operator.recordings.get(recording_id)))


@router.delete("/{recording_id}", status_code=204, responses=refusals(404, 409, 422))
def delete_recording(recording_id: RecordingId, operator: TheOperator) -> Response:
    """Remove a finished one."""
    operator.recordings.delete(recording_id)
    return Response(status_code=204)


@router.get("/{recording_id}/download", response_class=FileResponse, responses={**_FILE, **refusals(404, 422)})
def download_recording(recording_id: RecordingId, operator: TheOperator) -> Response:
    """The MCAP file of a finished one, for Foxglove, Lichtblick, Rerun or PlotJuggler."""
    path = operator.recordings.file(recording_id)
    return FileResponse(path, media_type="application/octet-stream", filename=path.name)


@router.post(
    "/{recording_id}/estimates",
    status_code=202,
    response_model=EstimatesCreatedAnswer,
    responses=refusals(404, 409, 413, 422),
)
def start_estimates(recording_id: RecordingId, body: EstimatesRequest, operator: TheOperator) -> Response:
    """Run an estimator over a finished recording, in a process of its own."""
    gains = (body.gains.k1, body.gains.k2) if "gains" in body.model_fields_set else None
    path = operator.recordings.file(recording_id)
    return json_response({"id": operator.estimates.start(recording_id, path, body.estimator, gains)}, 202)


@router.get("/{recording_id}/estimates/{estimates_id}", response_model=EstimatesAnswer, responses=refusals(404, 422))
def get_estimates(
    recording_id: RecordingId, estimates_id: Annotated[int, Path(ge=1, examples=[1])], operator: TheOperator
) -> Response:
    """How far it is, and the forces once it is done."""
    return json_response(operator.estimates.result(recording_id, estimates_id))


def _answer(row: RecordingRow) -> RecordingAnswer:
    return RecordingAnswer(**asdict(row))
