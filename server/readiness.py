"""Whether commands would act now. Liveness, `GET /api/v1/health`, is another question: it also holds while a scene loads."""

from server.control_client import ControlClient
from server.state import failure


def unready_because(client: ControlClient) -> str | None:
    """Why commands would not act now, None if they would."""
    death = client.death
    if death is not None:
        return f"the control process does not run: {death}"
    if client.busy:
        return "the control process starts, or loads a scene"
    snapshot = client.snapshot()
    if snapshot is None:
        return "there is no snapshot yet"
    if client.stalled:
        return "the control process hangs"
    return failure(snapshot)
