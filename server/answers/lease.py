"""Schemas of the lease."""

from server.answers.schema import Answer


class LeaseAnswer(Answer):
    """Who commands."""

    operator: str | None
    """name of who holds the lease; null: nobody, and anyone's commands are accepted"""
    yours: bool
    """the caller holds it"""
    expires_s: float | None
    """s for which it holds without a further word of its holder; null while nobody holds it"""


class LeaseTakenAnswer(Answer):
    """The caller commands, and the rest watch."""

    token: str
    """shown as the header `Forcelens-Lease` by whatever shall act for this operator; a page is known by its cookie, too"""
    expires_s: float
    """s for which it holds without a further word"""
