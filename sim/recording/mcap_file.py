"""A writer of MCAP files in chunks of batches. What is written is safe once its chunk is: see sim.recording.repair.

Attachments, metadata, schemas and channels come first, so that a file that was cut off has them. https://mcap.dev/spec
"""

import fcntl
import os
import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

MAGIC = b"\x89MCAP0\r\n"
CHUNK, MESSAGE_INDEX = 6, 7
COMPRESSION = "zstd"
_COMPRESSION = zstandard.ZstdCompressionParameters.from_level(3, min_match=4)
"""Numbers that differ in their last bytes have matches of four."""


class McapWriter:
    """Writes one file, from its start to its footer.

    Args:
        path: of the file, which must not exist.
        library: who writes.
        synced: chunks go to the disk itself before more is written.
    """

    def __init__(self, path: Path, library: str, *, synced: bool = False) -> None:
        self._file = path.open("xb")
        fcntl.flock(self._file, fcntl.LOCK_EX)  # who repairs files leaves those alone that are written
        self._synced = synced
        self._compressor = zstandard.ZstdCompressor(compression_params=_COMPRESSION)
        self.summary = Summary()
        self._file.write(MAGIC)
        self._write(Header(profile="", library=library))

    @property
    def size_bytes(self) -> int:
        """Of what is written."""
        return self._file.tell()

    def attach(self, name: str, media_type: str, data: bytes, time_ns: int) -> None:
        """Add an attachment."""
        record = Attachment(create_time=time_ns, log_time=time_ns, name=name, media_type=media_type, data=data)
        offset = self._write(record)
        length = self._file.tell() - offset
        self.summary.attachments.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                create_time=time_ns,
                log_time=time_ns,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def describe(self, name: str, values: dict[str, str]) -> None:
        """Add metadata."""
        offset = self._write(Metadata(name=name, metadata=values))
        self.summary.metadata.append(MetadataIndex(offset=offset, length=self._file.tell() - offset, name=name))

    def channel(self, topic: str, schema: str, encoding: str, descriptors: bytes) -> int:
        """Add a channel with a schema of its own; the number that messages of it carry."""
        number = len(self.summary.channels) + 1
        message_encoding = "json" if encoding == "jsonschema" else encoding
        self._add(self.summary.schemas, Schema(id=number, name=schema, encoding=encoding, data=descriptors))
        self._add(
            self.summary.channels,
            Channel(id=number, topic=topic, message_encoding=message_encoding, metadata={}, schema_id=number),
        )
        return number

    def write_chunk(self, batches: Iterable[np.ndarray]) -> None:
        """Write message records (arrays whose dtype is Wire.record) as one chunk; nothing where there is none."""
        batches = [batch for batch in batches if len(batch)]
        if not batches:
            return
        data = b"".join(batch.tobytes() for batch in batches)
        index: dict[int, np.ndarray] = {}
        offset, start_ns, end_ns = 0, 2**64 - 1, 0
        for batch in batches:
            entries = np.empty((len(batch), 2), "<u8")
            entries[:, 0] = batch["log"]
            entries[:, 1] = offset + batch.dtype.itemsize * np.arange(len(batch))
            offset += batch.nbytes
            channel = int(batch["channel"][0])
            index[channel] = np.concatenate([index[channel], entries]) if channel in index else entries
            start_ns, end_ns = min(start_ns, int(batch["log"].min())), max(end_ns, int(batch["log"].max()))
        packed = self._compressor.compress(data)
        body = struct.pack("<QQQI", start_ns, end_ns, len(data), zlib.crc32(data))
        body += struct.pack("<I", len(COMPRESSION)) + COMPRESSION.encode() + struct.pack("<Q", len(packed)) + packed
        chunk_at = self._file.tell()
        chunk = struct.pack("<BQ", CHUNK, len(body)) + body
        offsets, indexes = message_indexes(index, chunk_at + len(chunk))
        self._file.write(chunk + indexes)
        self._file.flush()
        if self._synced:
            os.fdatasync(self._file.fileno())
        self.summary.chunks.append(
            ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=chunk_at,
                compression=COMPRESSION,
                compressed_size=len(packed),
                message_end_time=end_ns,
                message_index_length=len(indexes),
                message_index_offsets=offsets,
                message_start_time=start_ns,
                uncompressed_size=len(data),
            )
        )
        for channel, entries in index.items():
            self.summary.counts[channel] = self.summary.counts.get(channel, 0) + len(entries)

    def close(self) -> None:
        """Write summary and footer."""
        with self._file:
            self.summary.write(self._file)
            os.fsync(self._file.fileno())

    def abandon(self) -> None:
        """Leave the file as it is, without an end."""
        self._file.close()

    def _add(self, records: list[McapRecord], record: McapRecord) -> None:
        self._write(record)
        records.append(record)

    def _write(self, record: McapRecord) -> int:
        """Append a record; where it lies."""
        offset = self._file.tell()
        self._file.write(built(record))
        return offset


class Summary:
    """What stands at the end of a file and tells where everything lies."""

    def __init__(self) -> None:
        self.schemas: list[McapRecord] = []
        self.channels: list[McapRecord] = []
        self.chunks: list[ChunkIndex] = []
        self.attachments: list[AttachmentIndex] = []
        self.metadata: list[MetadataIndex] = []
        self.counts: dict[int, int] = {}

    def write(self, file: BinaryIO) -> None:
        """Append the end of the data, this and the footer."""
        file.write(built(DataEnd(data_section_crc=0)))
        start = file.tell()
        statistics = Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=self.counts,
            chunk_count=len(self.chunks),
            message_count=sum(self.counts.values()),
            message_end_time=max((chunk.message_end_time for chunk in self.chunks), default=0),
            message_start_time=min((chunk.message_start_time for chunk in self.chunks), default=0),
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )
        records = [*self.schemas, *self.channels, statistics, *self.chunks, *self.attachments, *self.metadata]
        data = b"".join(map(built, records))
        checked = zlib.crc32(struct.pack("<BQQQ", 2, 20, start, 0), zlib.crc32(data))
        file.write(data + built(Footer(summary_start=start, summary_offset_start=0, summary_crc=checked)) + MAGIC)


def built(record: McapRecord) -> bytes:
    """Bytes of a record."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def message_indexes(index: dict[int, np.ndarray], start: int) -> tuple[dict[int, int], bytes]:
    """Message index records that lie at `start`: the offset of each channel's, and their bytes.

    Args:
        index: entries (n, 2) u8 of time in ns and offset in the chunk's data, by channel.
        start: offset in the file.
    """
    offsets: dict[int, int] = {}
    data = b""
    for channel, entries in index.items():
        offsets[channel] = start + len(data)
        body = struct.pack("<HI", channel, entries.nbytes) + np.ascontiguousarray(entries, "<u8").tobytes()
        data += struct.pack("<BQ", MESSAGE_INDEX, len(body)) + body
    return offsets, data
