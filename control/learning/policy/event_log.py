"""Live curves of a training run: TensorBoard event files, where that package is installed."""

import logging
from collections.abc import Mapping
from pathlib import Path

logger = logging.getLogger(__name__)


class EventLog:
    """Writes scalars over environment steps; without TensorBoard it says so once and writes nothing.

    Attributes:
        active: whether event files are written.
    """

    def __init__(self, folder: Path, from_step: int = 0) -> None:
        """`folder` of the files. What an interrupted run wrote there beyond `from_step` is superseded."""
        try:
            # An optional package: training itself does not need it.
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            logger.info('no TensorBoard files: TensorBoard is not installed (`pip install -e ".[train]"`)')
            self._writer = None
        else:
            self._writer = SummaryWriter(str(folder), purge_step=from_step)
        self.active = self._writer is not None

    def add(self, step: int, values: Mapping[str, float]) -> None:
        """Append one point to each curve, named "group/name"."""
        if self._writer is None:
            return
        for name, value in values.items():
            self._writer.add_scalar(name, value, step)
        self._writer.flush()
