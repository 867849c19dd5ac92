"""Takes what objects carry from tick to tick, and puts it back, so that from there the very same future follows.

A stateful class names what it carries in `STATE`, and in `SCRATCH` what it overwrites before it reads it. Everything else
that it holds must stay as constructed; `tests/sim/runtime/test_state_capture.py` finds what changes and is named in neither.
A class may define `pack_state()`, called before it is taken, and `unpack_state()`, called once everything is back.

Nothing is rebuilt: every attribute becomes the very object again that it was, with the content that it had. What shared an
array or an observer shares it again, and comparisons by identity hold.
"""

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import is_dataclass
from enum import Enum
from functools import cache
from itertools import islice
from operator import attrgetter
from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np

from control.values import VALUE_MARK

_PLAIN = (int, float, complex, str, bytes, type(None), Enum, np.generic, np.dtype, frozenset, PurePath, type)
"""Cannot change, so that a reference suffices."""


class StateError(TypeError):
    """Something that an object carries cannot be taken; the message names it and the cure."""


@cache
def state_names(kind: type) -> tuple[str, ...] | None:
    """Attributes that a class and its bases carry, None if none of them says."""
    return _named(kind, "STATE")


@cache
def scratch_names(kind: type) -> tuple[str, ...]:
    """Attributes that a class and its bases overwrite before they read them."""
    return _named(kind, "SCRATCH") or ()


def is_frozen(kind: type) -> bool:
    """Whether a type is a dataclass whose fields cannot be set, or a value (control.values), whose fields nobody sets."""
    if not is_dataclass(kind):
        return False
    return getattr(kind, VALUE_MARK, False) or kind.__dataclass_params__.frozen  # pyright: ignore[reportAttributeAccessIssue]


class _Plan(NamedTuple):
    """How objects of one class are taken."""

    names: tuple[str, ...]
    values: Callable[[Any], tuple[Any, ...]]
    packs: bool
    unpacks: bool


class Moment:
    """What objects carried at one moment.

    Args:
        roots: objects whose classes have STATE, with all that they carry.

    Raises:
        StateError: something that they carry has no STATE and is neither plain nor an array.
    """

    __slots__ = ("_arrays", "_carriers", "_contents", "_dicts", "_generators", "_lists", "_plans", "_seen", "_values")

    def __init__(self, *roots: object) -> None:
        # Lists side by side, with the values of all objects in one: the fewer objects are made, the rarer the garbage
        # collector looks at them, which costs as much as half of a moment.
        self._carriers: list[Any] = []
        self._plans: list[_Plan] = []
        self._values: list[Any] = []
        self._arrays: list[np.ndarray] = []
        self._contents: list[bytes] = []
        self._dicts: list[tuple[dict[Any, Any], dict[Any, Any]]] = []
        self._lists: list[tuple[Any, tuple[Any, ...]]] = []
        self._generators: list[tuple[np.random.Generator, Any]] = []
        self._seen: set[int] = set()
        self._take_all(roots)
        self._seen.clear()

    def restore(self) -> None:
        """Put it back. May be called again later."""
        values = iter(self._values)
        for carrier, plan in zip(self._carriers, self._plans, strict=True):
            for name in plan.names:
                setattr(carrier, name, next(values))
        for array, content in zip(self._arrays, self._contents, strict=True):
            np.copyto(array, content_of(array, content))
        for mapping, items in self._dicts:
            mapping.clear()
            mapping.update(items)
        for sequence, items in self._lists:
            sequence.clear()
            sequence.extend(items)
        for generator, state in self._generators:
            generator.bit_generator.state = state
        for carrier, plan in zip(self._carriers, self._plans, strict=True):
            if plan.unpacks:
                carrier.unpack_state()

    def held(self) -> dict[int, Any]:
        """What was held then, by the `id` of what held it: values of an object in the order of `state_names`, bytes of an
        array, items of a dict, a list or a deque.
        """
        values = iter(self._values)
        carried = [tuple(islice(values, len(plan.names))) for plan in self._plans]
        held: dict[int, Any] = {}
        for holders, contents in ((self._carriers, carried), (self._arrays, self._contents)):
            held |= zip(map(id, holders), contents, strict=True)
        for pairs in (self._dicts, self._lists):
            held |= {id(holder): content for holder, content in pairs}
        return held

    def views(self) -> dict[int, list[tuple[np.ndarray, bytes]]]:
        """Arrays that are views, with their bytes then, by the `id` of the array that they are views of."""
        found: dict[int, list[tuple[np.ndarray, bytes]]] = {}
        for array, content in zip(self._arrays, self._contents, strict=True):
            if isinstance(array.base, np.ndarray):
                found.setdefault(id(array.base), []).append((array, content))
        return found

    @property
    def array_bytes(self) -> int:
        """Size of the arrays' content."""
        return sum(map(len, self._contents))

    def _take_all(self, values: Iterable[Any]) -> None:
        # Runs between two ticks of a robot: lookups instead of calls, where it can be.
        seen = self._seen
        for value in values:
            take = _takers[type(value)]
            if take is not None and id(value) not in seen:
                seen.add(id(value))
                take(self, value)

    def _take_object(self, carrier: Any) -> None:
        plan = _plan(type(carrier))
        if plan.packs:
            carrier.pack_state()
        try:
            values = plan.values(carrier)
        except AttributeError as error:
            raise StateError(f"STATE names what is not there: {error}") from None
        self._carriers.append(carrier)
        self._plans.append(plan)
        self._values.extend(values)
        try:
            self._take_all(values)
        except StateError as error:
            raise StateError(f"{type(carrier).__name__} carries {error}") from None

    def _take_array(self, array: np.ndarray) -> None:
        if array.flags.writeable:
            self._arrays.append(array)
            self._contents.append(array.tobytes())  # a fraction of what a copy costs

    def _take_dict(self, mapping: dict[Any, Any]) -> None:
        self._dicts.append((mapping, mapping.copy()))
        self._take_all(mapping.values())

    def _take_list(self, sequence: Any) -> None:
        items = tuple(sequence)
        self._lists.append((sequence, items))
        self._take_all(items)

    def _take_generator(self, generator: np.random.Generator) -> None:
        self._generators.append((generator, generator.bit_generator.state))


def content_of(array: np.ndarray, data: bytes) -> np.ndarray:
    """What an array held when `tobytes` gave these."""
    return np.ndarray(array.shape, array.dtype, data)


class _Takers(dict[type, Callable[[Moment, Any], None] | None]):
    """How to take a value, by its type; None where a reference suffices."""

    def __missing__(self, kind: type) -> Callable[[Moment, Any], None] | None:
        self[kind] = taker = _taker(kind)
        return taker


_takers = _Takers()


def _taker(kind: type) -> Callable[[Moment, Any], None] | None:
    if state_names(kind) is not None:
        return Moment._take_object
    if issubclass(kind, np.ndarray):
        return Moment._take_array
    if issubclass(kind, dict):
        return Moment._take_dict
    if issubclass(kind, list | deque):
        return Moment._take_list
    if issubclass(kind, np.random.Generator):
        return Moment._take_generator
    if is_frozen(kind) or issubclass(kind, _PLAIN):
        return None
    if issubclass(kind, tuple):
        return Moment._take_all
    raise StateError(f"{kind.__name__}, which does not say what it carries; name that in its STATE (see control.state.capture)")


@cache
def _plan(kind: type) -> _Plan:
    names = state_names(kind) or ()
    one = len(names) < 2
    values = (lambda carrier: tuple(getattr(carrier, name) for name in names)) if one else attrgetter(*names)
    return _Plan(names, values, hasattr(kind, "pack_state"), hasattr(kind, "unpack_state"))


def _named(kind: type, what: str) -> tuple[str, ...] | None:
    named = [vars(base)[what] for base in kind.__mro__ if what in vars(base)]
    return tuple(dict.fromkeys(name for names in named for name in names)) if named else None
