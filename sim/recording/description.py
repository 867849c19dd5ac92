"""What a recording is started with. Light: the recorder imports it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Description:
    """Of one recording; picklable.

    Attributes:
        metadata: texts by name: backend, scene, seeds, versions, configuration and so on.
        estimators: names of the pipeline's, in the order of TICK.
        attachments: (name, media type, data).
    """

    metadata: dict[str, str]
    estimators: tuple[str, ...]
    attachments: tuple[tuple[str, str, bytes], ...]
