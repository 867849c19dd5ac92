"""What a recording is started with. Light: the recorder imports it."""

from dataclasses import dataclass

STATE_TYPE = "application/zstd"


def keyframe_name(tick: int | str) -> str:
    """Name of the attachment with the packed state of the pipeline before a tick of the recording's count, compressed."""
    return f"keyframe-{tick}.zst"


@dataclass(frozen=True, slots=True)
class Description:
    """Of one recording; picklable.

    Attributes:
        metadata: texts by name: backend, scene, seeds, versions, configuration and so on.
        estimators: names of the pipeline's, in the order of TICK.
        keyframe: packed state (control.state.file) of the pipeline at its start.
        attachments: (name, media type, data) of what else is in it.
    """

    metadata: dict[str, str]
    estimators: tuple[str, ...]
    keyframe: bytes
    attachments: tuple[tuple[str, str, bytes], ...] = ()
