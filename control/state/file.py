"""What an object carried at a moment, as bytes for a file: plain values by number and the arrays' bytes, nothing that runs
when it is read.

Values of frozen dataclasses and enumerations are named by their class, which must be one of ours. What was shared is shared
again, and so is the memory of arrays that were views of one another.
"""

import importlib
import json
import struct
from collections import deque
from dataclasses import fields
from enum import Enum
from typing import Any

import numpy as np

from control.state.capture import Moment, content_of, is_frozen, state_names

FORMAT = 2
_OURS = "control"

_HEAD = struct.Struct("<Q")
# The length of a JSON text, this text, and the bytes of all arrays. The text has `nodes`, of which the first is the object
# itself. Where a node holds another one stands its number in a list of one; plain values stand as they are.


class StateFileError(ValueError):
    """Bytes that are no state of this object and version; the message says what does not fit."""


def packed_state(root: object) -> bytes:
    """What an object with STATE carries now (control.state.capture)."""
    packing = StatePacking(root, Moment(root))
    while not packing.advance(1000):
        pass
    return packing.data()


def unpack_state(data: bytes, root: object) -> None:
    """Put packed state into an object made as the packed one was.

    Raises:
        StateFileError: it was made otherwise, or by another version.
    """
    try:
        end = _HEAD.size + _HEAD.unpack_from(data)[0]
        document = json.loads(data[_HEAD.size : end])
        if document["format"] != FORMAT:
            raise StateFileError(f"state of format {document['format']}; this version reads {FORMAT}")
        unpacking = _Unpacking(document["nodes"], data[end:])
        unpacking.value([0], root)
    except (struct.error, LookupError, TypeError, AttributeError, ImportError, ValueError) as error:
        raise StateFileError(f"the state does not fit this version: {error}") from error
    for carrier in unpacking.carriers:
        unpack = getattr(carrier, "unpack_state", None)
        if unpack is not None:
            unpack()


class StatePacking:
    """Packs what an object carried at a moment, as slowly as is wished, while the object goes on.

    Args:
        root: the object.
        moment: with the object in it.
    """

    def __init__(self, root: object, moment: Moment) -> None:
        self._held = moment.held()
        self._views = moment.views()
        self._found: list[Any] = []
        self._numbers: dict[int, int] = {}
        self._nodes: list[str] = []
        self._content: list[bytes] = []
        self._content_bytes = 0
        self._value(root)

    def advance(self, most: int) -> bool:
        """Pack at most so many more of the values that hold others; whether all are packed.

        Raises:
            StateFileError: one has no place in a file.
        """
        for number in range(len(self._nodes), len(self._nodes) + most):
            if number == len(self._found):
                break
            self._nodes.append(json.dumps(self._node(self._found[number])))
        return len(self._nodes) == len(self._found)

    def data(self) -> bytes:
        """The bytes, once all are packed."""
        text = f'{{"format": {FORMAT}, "nodes": [{",".join(self._nodes)}]}}'.encode()
        return b"".join((_HEAD.pack(len(text)), text, *self._content))

    def _value(self, value: Any) -> Any:
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, Enum):
            return {"enum": _name(type(value)), "value": value.value}
        if isinstance(value, np.generic):
            return self._value(value.item())
        if id(value) not in self._numbers:
            self._numbers[id(value)] = len(self._found)
            self._found.append(value)
        return [self._numbers[id(value)]]

    def _node(self, value: Any) -> dict[str, Any]:
        kind = type(value)
        held = self._held.get(id(value))
        names = state_names(kind)
        if names is not None:
            items = [getattr(value, name) for name in names] if held is None else held
            return {"object": _name(kind), "fields": dict(zip(names, map(self._value, items), strict=True))}
        if is_frozen(kind):
            items = {field.name: self._value(getattr(value, field.name)) for field in fields(value)}
            return {"frozen": _name(kind), "fields": items}
        if isinstance(value, np.ndarray):
            return self._array(value)
        if isinstance(value, dict):
            items = value if held is None else held
            return {"dict": [[self._value(key), self._value(item)] for key, item in items.items()]}
        for sequence in (list, tuple, deque):
            if isinstance(value, sequence):
                return {sequence.__name__: [self._value(item) for item in (value if held is None else held)]}
        raise StateFileError(f"{kind.__name__} has no place in a file")

    def _array(self, array: np.ndarray) -> dict[str, Any]:
        base = array.base
        if isinstance(base, np.ndarray) and array.dtype.names is None:
            place = {"offset": _offset(array, base), "strides": array.strides}
            return {"view": self._value(base), "shape": array.shape, "dtype": array.dtype.str, **place}
        data = self._content_of(array).tobytes(order="F" if array.flags.fnc else "C")
        at = self._content_bytes
        self._content.append(data)
        self._content_bytes += len(data)
        descr = np.lib.format.dtype_to_descr(array.dtype)
        return {"array": at, "shape": array.shape, "dtype": descr, "fortran": array.flags.fnc}

    def _content_of(self, array: np.ndarray) -> np.ndarray:
        """Of then, also where only views of it are state."""
        held = self._held.get(id(array))
        if held is not None:
            return content_of(array, held)
        content = array.copy(order="A") if id(array) in self._views else array
        for view, then in self._views.get(id(array), ()):
            place = np.ndarray(view.shape, view.dtype, content, _offset(view, array), view.strides)
            place[...] = content_of(view, then)
        return content


class _Unpacking:
    def __init__(self, nodes: list[dict[str, Any]], content: bytes) -> None:
        self.carriers: list[Any] = []
        self._nodes = nodes
        self._content = content
        self._made: dict[int, Any] = {}

    def value(self, value: Any, present: Any) -> Any:
        """What a value of a node stands for; `present` is what stands at its place now."""
        if isinstance(value, dict):
            return _class(value["enum"])(value["value"])
        if not isinstance(value, list):
            return value
        (number,) = value
        if number not in self._made:
            node = self._nodes[number]
            if "object" in node:
                self._make_object(number, node, present)
            else:
                self._made[number] = self._compound(node, present)
        return self._made[number]

    def _make_object(self, number: int, node: dict[str, Any], present: Any) -> None:
        kind = _class(node["object"])
        if type(present) is not kind:
            present = kind.__new__(kind)
        self._made[number] = present
        self.carriers.append(present)
        for name, child in node["fields"].items():
            setattr(present, name, self.value(child, getattr(present, name, None)))

    def _compound(self, node: dict[str, Any], present: Any) -> Any:
        if "frozen" in node:
            return _class(node["frozen"])(**{name: self.value(child, None) for name, child in node["fields"].items()})
        if "view" in node:
            base = self.value(node["view"], None)
            return np.ndarray(tuple(node["shape"]), node["dtype"], base, node["offset"], tuple(node["strides"]))
        if "array" in node:
            return self._array(node, present)
        if "dict" in node:
            return self._dict(node["dict"], present)
        kind, items = next((kind, node[kind.__name__]) for kind in (list, tuple, deque) if kind.__name__ in node)
        return kind(self.value(item, None) for item in items)

    def _array(self, node: dict[str, Any], present: Any) -> np.ndarray:
        dtype, order = np.dtype(_as_tuples(node["dtype"])), "F" if node["fortran"] else "C"
        array = np.ndarray(tuple(node["shape"]), dtype, self._content, node["array"], order=order).copy(order="A")
        fits = isinstance(present, np.ndarray) and present.base is None and present.flags.writeable
        if fits and present.shape == array.shape and present.dtype == array.dtype:
            np.copyto(present, array)
            return present
        return array

    def _dict(self, items: list[Any], present: Any) -> dict[Any, Any]:
        made = present if isinstance(present, dict) else {}
        before = dict(made)
        made.clear()
        for key_node, child in items:
            key = self.value(key_node, None)
            made[key] = self.value(child, before.get(key))
        return made


def _offset(view: np.ndarray, base: np.ndarray) -> int:
    """Bytes from the start of an array to that of a view of it."""
    return view.__array_interface__["data"][0] - base.__array_interface__["data"][0]


def _as_tuples(descr: Any) -> Any:
    """A dtype's description out of JSON, which knows lists only."""
    if isinstance(descr, str):
        return descr
    return [(name, _as_tuples(kind), *(tuple(shape) for shape in shapes)) for name, kind, *shapes in descr]


def _name(kind: type) -> str:
    return f"{kind.__module__}:{kind.__qualname__}"


def _class(name: str) -> Any:
    module, _, qualified = name.partition(":")
    kind = getattr(importlib.import_module(module), qualified) if module.split(".")[0] == _OURS else None
    if not (isinstance(kind, type) and (issubclass(kind, Enum) or is_frozen(kind) or state_names(kind) is not None)):
        raise StateFileError(f"{name} is no class whose state is kept")
    return kind
