"""Schemas of what REST answers instead where it does not do as asked."""

from server.answers.schema import Answer


class RefusalAnswer(Answer):
    """Nothing changed."""

    detail: str
    """why, and what to do"""


class InvalidField(Answer):
    """A field that is not allowed."""

    field: str
    """its path, like `force_n[2]`"""
    msg: str
    """why, for people"""
    allowed: str
    """range or choice in words"""


class InvalidAnswer(Answer):
    """Nothing changed."""

    detail: list[InvalidField]
    """one entry per field"""
