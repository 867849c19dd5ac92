"""Protobuf messages of constant length, so that a numpy array is a batch of them as they go over the wire.

A message whose fields are doubles, packed repeated numbers, texts of one length and submessages of doubles always has the same
bytes between its values: tags and lengths. A numpy dtype that has these as constant fields is the encoding, and assigning a
column encodes that field of a whole batch. https://protobuf.dev/programming-guides/encoding
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2

_FIELD = descriptor_pb2.FieldDescriptorProto
_DOUBLE, _BYTES = 1, 2
"""Wire types: 64 bits, and a length with that many bytes."""

VECTOR = "vector"
"""Kind of a field that is a submessage {x, y, z}: plotters name such values, elements of arrays they do not."""

SINGLE = "F"
"""First letter of the kind of a field with numbers of single precision."""

MESSAGE_OPCODE = 5
Kind = int | str
"""1: a double. n: n doubles, repeated. "F<n>": n of single precision. VECTOR. "S<n>": a text of n bytes, padded with NUL."""


class Wire:
    """One message type.

    Attributes:
        name: of the type, with its package.
        descriptors: serialised FileDescriptorSet, which makes a file self-describing.
        body: dtype of one message; its fields have the message's names, of vectors `name.x` and so on.
        record: dtype of an MCAP message record around it, with `log` and `publish` times in ns.
    """

    def __init__(self, name: str, fields: Mapping[str, Kind], package: str = "forcelens") -> None:
        self.name = f"{package}.{name}"
        self.fields = dict(fields)
        file = _FIELDS_FILE(name=f"{name}.proto", package=package, syntax="proto3")
        if VECTOR in fields.values():
            vector = file.message_type.add(name="Vector3")
            for number, axis in enumerate("xyz", start=1):
                vector.field.add(name=axis, number=number, type=_FIELD.TYPE_DOUBLE, label=_FIELD.LABEL_OPTIONAL)
        message = file.message_type.add(name=name)
        layout: list[Any] = []
        constants: dict[str, bytes] = {}

        def constant(data: bytes) -> None:
            key = f"_{len(layout)}"
            layout.append((key, f"V{len(data)}"))
            constants[key] = data

        for number, (field, kind) in enumerate(fields.items(), start=1):
            if kind == VECTOR:
                kind_name = f".{package}.Vector3"
                message.field.add(
                    name=field, number=number, type=_FIELD.TYPE_MESSAGE, type_name=kind_name, label=_FIELD.LABEL_OPTIONAL
                )
                constant(_tag(number, _BYTES) + _varint(27))
                for sub, axis in enumerate("xyz", start=1):
                    constant(_tag(sub, _DOUBLE))
                    layout.append((f"{field}.{axis}", "<f8"))
            elif isinstance(kind, str) and kind.startswith(SINGLE):
                count = int(kind[1:])
                message.field.add(name=field, number=number, type=_FIELD.TYPE_FLOAT, label=_FIELD.LABEL_REPEATED)
                constant(_tag(number, _BYTES) + _varint(4 * count))
                layout.append((field, "<f4", (count,)))
            elif isinstance(kind, str):
                message.field.add(name=field, number=number, type=_FIELD.TYPE_BYTES, label=_FIELD.LABEL_OPTIONAL)
                constant(_tag(number, _BYTES) + _varint(int(kind[1:])))
                layout.append((field, kind))
            elif kind == 1:
                message.field.add(name=field, number=number, type=_FIELD.TYPE_DOUBLE, label=_FIELD.LABEL_OPTIONAL)
                constant(_tag(number, _DOUBLE))
                layout.append((field, "<f8"))
            else:
                message.field.add(name=field, number=number, type=_FIELD.TYPE_DOUBLE, label=_FIELD.LABEL_REPEATED)
                constant(_tag(number, _BYTES) + _varint(8 * kind))
                layout.append((field, "<f8", (kind,)))
        self.descriptors = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()
        self.body = np.dtype(layout)
        self.record = np.dtype(
            [
                ("opcode", "u1"),
                ("length", "<u8"),
                ("channel", "<u2"),
                ("sequence", "<u4"),
                ("log", "<u8"),
                ("publish", "<u8"),
                ("body", self.body),
            ]
        )
        self._template = np.zeros((), self.record)
        self._template["opcode"], self._template["length"] = MESSAGE_OPCODE, 22 + self.body.itemsize
        for key, data in constants.items():
            self._template["body"][key] = np.void(data)

    def batch(self, times_ns: np.ndarray, channel: int) -> np.ndarray:
        """(n,) message records of `record` at times (n,), values zero."""
        records = np.full(len(times_ns), self._template)
        records["channel"], records["log"], records["publish"] = channel, times_ns, times_ns
        return records


_FIELDS_FILE = descriptor_pb2.FileDescriptorProto


def _tag(number: int, wire_type: int) -> bytes:
    return _varint(number << 3 | wire_type)


def _varint(value: int) -> bytes:
    data = b""
    while value > 0x7F:
        data += bytes([value & 0x7F | 0x80])
        value >>= 7
    return data + bytes([value])
