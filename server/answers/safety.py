"""Schema of the e-stop."""

from typing import Annotated, Literal

from server.answers.schema import Answer, names_of
from sim.runtime.snapshot import Mode


class EstopAnswer(Answer):
    """The e-stop as the backend reports it."""

    latched: bool
    """until it is cleared"""
    mode: Annotated[str, names_of(Mode)]
    """as in the state"""


class EstopCheckAnswer(Answer):
    """Nothing changed."""

    may_stop: Literal[True]
    """this caller may press the e-stop; one that may not is refused like there"""
