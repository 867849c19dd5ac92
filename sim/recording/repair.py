"""Repairs a recording whose writer was killed: cuts it behind the last whole chunk and writes the summary that is missing.

Only record heads are read, and the last chunk, which may be torn: its message indexes are made anew from its data.
"""

import io
import os
import struct
import zlib
from pathlib import Path
from typing import BinaryIO

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.records import Attachment, AttachmentIndex, Channel, ChunkIndex, Metadata, MetadataIndex, Schema

from sim.recording.mcap_file import CHUNK, MAGIC, MESSAGE_INDEX, Summary, built, message_indexes
from sim.recording.wire import MESSAGE_OPCODE

_HEAD = struct.Struct("<BQ")
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _ATTACHMENT, _METADATA, _DATA_END = 1, 2, 3, 4, 9, 12, 15


REPAIRED = "repaired"
"""Name of the metadata that a repaired file has."""

_REPAIRED = built(Metadata(name=REPAIRED, metadata={}))


class NoRecordingError(ValueError):
    """A file that is no MCAP file, or was cut off before anything was recorded."""


def is_whole(path: Path) -> bool:
    """Whether a file has its end."""
    with path.open("rb") as file:
        start = file.read(len(MAGIC))
        file.seek(-min(len(MAGIC), os.path.getsize(path)), os.SEEK_END)
        return start == MAGIC and os.path.getsize(path) > 2 * len(MAGIC) and file.read() == MAGIC


def repair(path: Path) -> None:
    """Give a file its end, in place.

    Raises:
        NoRecordingError: there is nothing in it.
    """
    with path.open("r+b") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise NoRecordingError(f"{path} is no MCAP file")
        summary, end = _read(file, os.path.getsize(path))
        if summary.chunks:
            end = _mend_last_chunk(file, summary)
        if not summary.channels:
            raise NoRecordingError(f"{path} was cut off before anything was recorded")
        file.truncate(end)
        file.seek(end)
        summary.metadata.append(MetadataIndex(offset=end, length=file.write(_REPAIRED), name=REPAIRED))
        summary.write(file)
        os.fsync(file.fileno())


def _read(file: BinaryIO, size: int) -> tuple[Summary, int]:
    """What the whole records of a file say, and where the last of them ends."""
    summary, position = Summary(), len(MAGIC)
    while position + _HEAD.size <= size:
        file.seek(position)
        opcode, length = _HEAD.unpack(file.read(_HEAD.size))
        end = position + _HEAD.size + length
        if opcode in (0, _FOOTER, _DATA_END) or end > size:
            break
        if opcode == CHUNK:
            summary.chunks.append(_chunk_index(file, position, length))
        elif opcode == MESSAGE_INDEX and summary.chunks:
            channel, entry_bytes = struct.unpack("<HI", file.read(6))
            chunk = summary.chunks[-1]
            chunk.message_index_offsets[channel] = position
            chunk.message_index_length += _HEAD.size + length
            summary.counts[channel] = summary.counts.get(channel, 0) + entry_bytes // 16
        elif opcode in (_SCHEMA, _CHANNEL, _ATTACHMENT, _METADATA):
            _take(summary, opcode, position, file.read(length))
        position = end
    return summary, position


def _take(summary: Summary, opcode: int, offset: int, body: bytes) -> None:
    stream, length = ReadDataStream(io.BytesIO(body)), _HEAD.size + len(body)
    if opcode == _SCHEMA:
        summary.schemas.append(Schema.read(stream))
    elif opcode == _CHANNEL:
        summary.channels.append(Channel.read(stream))
    elif opcode == _METADATA:
        summary.metadata.append(MetadataIndex(offset=offset, length=length, name=Metadata.read(stream).name))
    else:
        record = Attachment.read(stream)
        summary.attachments.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                create_time=record.create_time,
                log_time=record.log_time,
                data_size=len(record.data),
                name=record.name,
                media_type=record.media_type,
            )
        )


def _chunk_index(file: BinaryIO, position: int, length: int) -> ChunkIndex:
    start_ns, end_ns, uncompressed, _, name_length = struct.unpack("<QQQII", file.read(32))
    compression = file.read(name_length).decode()
    (compressed,) = struct.unpack("<Q", file.read(8))
    return ChunkIndex(
        chunk_length=_HEAD.size + length,
        chunk_start_offset=position,
        compression=compression,
        compressed_size=compressed,
        message_end_time=end_ns,
        message_index_length=0,
        message_index_offsets={},
        message_start_time=start_ns,
        uncompressed_size=uncompressed,
    )


def _mend_last_chunk(file: BinaryIO, summary: Summary) -> int:
    """Make the indexes of the last chunk anew, or drop it where it is torn; where the data ends then."""
    chunk = summary.chunks[-1]
    for channel, offset in chunk.message_index_offsets.items():
        file.seek(offset + _HEAD.size + 2)
        summary.counts[channel] -= struct.unpack("<I", file.read(4))[0] // 16
    file.seek(chunk.chunk_start_offset + _HEAD.size + 24)
    (checksum,) = struct.unpack("<I", file.read(4))
    file.seek(chunk.chunk_start_offset + chunk.chunk_length - chunk.compressed_size)
    try:
        data = zstandard.ZstdDecompressor().decompress(file.read(chunk.compressed_size))
    except zstandard.ZstdError:
        data = b""
    if zlib.crc32(data) != checksum or not data:
        summary.chunks.pop()
        return chunk.chunk_start_offset
    index: dict[int, list[tuple[int, int]]] = {}
    position = 0
    while position < len(data):
        opcode, length = _HEAD.unpack_from(data, position)
        if opcode == MESSAGE_OPCODE:
            channel, _, time_ns = struct.unpack_from("<HIQ", data, position + _HEAD.size)
            index.setdefault(channel, []).append((time_ns, position))
        position += _HEAD.size + length
    start = chunk.chunk_start_offset + chunk.chunk_length
    offsets, records = message_indexes({key: np.array(entries, "<u8") for key, entries in index.items()}, start)
    file.seek(start)
    file.write(records)
    chunk.message_index_offsets, chunk.message_index_length = offsets, len(records)
    for channel, entries in index.items():
        summary.counts[channel] = summary.counts.get(channel, 0) + len(entries)
    return start + len(records)
