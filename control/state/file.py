"""What an object carries, as bytes for a file: arrays by name and a tree of plain values, nothing that runs when it is read.

Values of frozen dataclasses and enumerations are named by their class, which must be one of ours. What was shared is shared
again, and so is the memory of arrays that were views of one another.
"""

import importlib
import io
import json
from collections import deque
from dataclasses import fields
from enum import Enum
from typing import Any

import numpy as np

from control.state.capture import is_frozen, state_names

FORMAT = 1
_OURS = "control"


class StateFileError(ValueError):
    """Bytes that are no state of this object and version; the message says what does not fit."""


def packed_state(root: object) -> bytes:
    """What an object with STATE carries (control.state.capture)."""
    packing = _Packing()
    tree = packing.value(root)
    text = json.dumps({"format": FORMAT, "root": tree}).encode()
    file = io.BytesIO()
    np.savez(file, tree=np.frombuffer(text, np.uint8), **packing.arrays)  # pyright: ignore[reportArgumentType]
    return file.getvalue()


def unpack_state(data: bytes, root: object) -> None:
    """Put packed state into an object made as the packed one was.

    Raises:
        StateFileError: it was made otherwise, or by another version.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        document = json.loads(arrays.pop("tree").tobytes())
        if document["format"] != FORMAT:
            raise StateFileError(f"state of format {document['format']}; this version reads {FORMAT}")
        unpacking = _Unpacking(arrays)
        unpacking.value(document["root"], root)
    except (KeyError, AttributeError, ImportError, ValueError) as error:
        raise StateFileError(f"the state does not fit this version: {error}") from error
    for carrier in unpacking.carriers:
        unpack = getattr(carrier, "unpack_state", None)
        if unpack is not None:
            unpack()


class _Packing:
    def __init__(self) -> None:
        self.arrays: dict[str, np.ndarray] = {}
        self._known: dict[int, int] = {}
        self._alive: list[Any] = []

    def value(self, value: Any) -> Any:
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, Enum):
            return {"enum": _name(type(value)), "value": value.value}
        if isinstance(value, np.generic):
            return self.value(value.item())
        if id(value) in self._known:
            return {"same": self._known[id(value)]}
        number = self._known[id(value)] = len(self._alive)
        self._alive.append(value)
        return {"id": number, **self._compound(value)}

    def _compound(self, value: Any) -> dict[str, Any]:
        names = state_names(type(value))
        if names is not None:
            return {"object": _name(type(value)), "fields": {name: self.value(getattr(value, name)) for name in names}}
        if is_frozen(type(value)):
            held = {field.name: self.value(getattr(value, field.name)) for field in fields(value)}
            return {"frozen": _name(type(value)), "fields": held}
        if isinstance(value, np.ndarray):
            return self._array(value)
        if isinstance(value, dict):
            return {"dict": [[self.value(key), self.value(item)] for key, item in value.items()]}
        for kind in (list, tuple, deque):
            if isinstance(value, kind):
                return {kind.__name__: [self.value(item) for item in value]}
        raise StateFileError(f"{type(value).__name__} has no place in a file")

    def _array(self, array: np.ndarray) -> dict[str, Any]:
        base = array.base
        if isinstance(base, np.ndarray) and array.dtype.names is None:
            offset = array.__array_interface__["data"][0] - base.__array_interface__["data"][0]
            place = {"offset": offset, "shape": array.shape, "strides": array.strides, "dtype": array.dtype.str}
            return {"view": self.value(base), **place}
        name = f"array_{len(self.arrays)}"
        self.arrays[name] = array
        return {"array": name}


class _Unpacking:
    def __init__(self, arrays: dict[str, np.ndarray]) -> None:
        self.carriers: list[Any] = []
        self._arrays = arrays
        self._made: dict[int, Any] = {}

    def value(self, node: Any, present: Any) -> Any:
        """What a node of the tree stands for; `present` is what stands at its place now."""
        if not isinstance(node, dict):
            return node
        if "enum" in node:
            return _class(node["enum"])(node["value"])
        if "same" in node:
            return self._made[node["same"]]
        if "object" in node:
            return self._object(node, present)
        made = self._made[node["id"]] = self._compound(node, present)
        return made

    def _object(self, node: Any, present: Any) -> Any:
        kind = _class(node["object"])
        if type(present) is not kind:
            present = kind.__new__(kind)
        self._made[node["id"]] = present
        self.carriers.append(present)
        for name, child in node["fields"].items():
            setattr(present, name, self.value(child, getattr(present, name, None)))
        return present

    def _compound(self, node: Any, present: Any) -> Any:
        if "frozen" in node:
            return _class(node["frozen"])(**{name: self.value(child, None) for name, child in node["fields"].items()})
        if "view" in node:
            base = self.value(node["view"], None)
            return np.ndarray(tuple(node["shape"]), node["dtype"], base, node["offset"], tuple(node["strides"]))
        if "array" in node:
            return self._array(self._arrays[node["array"]], present)
        if "dict" in node:
            return self._dict(node["dict"], present)
        kind, items = next((kind, node[kind.__name__]) for kind in (list, tuple, deque) if kind.__name__ in node)
        return kind(self.value(item, None) for item in items)

    def _array(self, array: np.ndarray, present: Any) -> np.ndarray:
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


def _name(kind: type) -> str:
    return f"{kind.__module__}:{kind.__qualname__}"


def _class(name: str) -> Any:
    module, _, qualified = name.partition(":")
    kind = getattr(importlib.import_module(module), qualified) if module.split(".")[0] == _OURS else None
    if not (isinstance(kind, type) and (issubclass(kind, Enum) or is_frozen(kind) or state_names(kind) is not None)):
        raise StateFileError(f"{name} is no class whose state is kept")
    return kind
