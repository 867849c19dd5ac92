"""Schema of the e-stop."""

from typing import Annotated

from server.answers.schema import Answer, names_of
from sim.runtime.snapshot import Mode


class EstopAnswer(Answer):
    """The e-stop as the backend reports it."""

    latched: bool
    """until it is cleared"""
    mode: Annotated[str, names_of(Mode)]
    """as in the state"""
