"""Reading an MCAP record by record, as far as it goes.

The mcap library's readers want a whole file. This one reads the same records (see
https://mcap.dev/spec) front to back, unpacks even the part of a compressed chunk that lies before
a cut, skips a chunk whose checksum is wrong, and keeps account of what it could not read.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Metadata
from mcap.writer import MCAP0_MAGIC as MAGIC

from .errors import NotARecordingError

_HEAD = struct.Struct("<BQ")  # opcode, length of the content
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; then the data
_CHUNK = struct.Struct("<QQQII")  # start, end, unpacked size, its CRC, length of the codec's name
UNKNOWN_TOPIC = "?"  # of a message whose channel is nowhere to be found
_UNREADABLE = (struct.error, zstandard.ZstdError, McapError, ValueError)  # of a damaged record
_KNOWN = frozenset(int(opcode) for opcode in Opcode)


class LoggedMessage(NamedTuple):
    """One message: its topic, log time in ns and still encoded data."""

    topic: str
    log_time: int
    data: bytes


class Damage(NamedTuple):
    """A place in the file from which something could not be read, and why."""

    byte: int
    reason: str


@dataclass
class Scan:
    """A pass over one MCAP file; ``metadata`` and ``damage`` are complete when it has ended.

    Attributes:
        at: where the record that is being read begins, in bytes.
        topics: topic of each channel met so far.
    """

    path: Path
    at: int = 0
    topics: dict[int, str] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    damage: list[Damage] = field(default_factory=list)

    def messages(self) -> Iterator[LoggedMessage]:
        """Every message that can be read, in file order.

        Raises:
            NotARecordingError: the file does not begin as an MCAP.
        """
        with self.path.open("rb") as stream:
            size = self.path.stat().st_size
            check_magic(self.path, stream)
            yield from self._records(stream, size)

    def _records(self, stream: IO[bytes], size: int) -> Iterator[LoggedMessage]:
        while True:
            self.at = stream.tell()
            head = stream.read(_HEAD.size)
            if len(head) < _HEAD.size:
                return self._note("the file ends without the MCAP footer")
            opcode, length = _HEAD.unpack(head)
            if opcode not in _KNOWN:
                return self._note(f"no MCAP record has the opcode {opcode}")
            left = size - stream.tell()
            content = stream.read(min(length, left))
            if length > left:
                name = Opcode(opcode).name.lower()
                self._note(f"a {name} record of {length} bytes has only {left} of them")
                if opcode == Opcode.CHUNK:
                    yield from self._contents(_unpack_part(content))
                return None
            if opcode == Opcode.FOOTER:
                if stream.read(len(MAGIC)) != MAGIC:
                    self._note("the closing magic bytes are missing")
                return None
            try:
                if opcode == Opcode.CHUNK:
                    yield from self._contents(_unpack(content))
                else:
                    yield from self._take(opcode, content)
            except _UNREADABLE as error:
                self._note(f"a {Opcode(opcode).name.lower()} record cannot be read ({error})")

    def _note(self, reason: str) -> None:
        self.damage.append(Damage(self.at, reason))

    def _contents(self, data: bytes) -> Iterator[LoggedMessage]:
        """The records in a chunk's data, up to the last whole one."""
        at = 0
        while at + _HEAD.size <= len(data):
            opcode, length = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            if at + length > len(data):
                return
            yield from self._take(opcode, data[at : at + length])
            at += length

    def _take(self, opcode: int, content: bytes) -> Iterator[LoggedMessage]:
        if opcode == Opcode.MESSAGE:
            channel, _, log_time, _ = _MESSAGE.unpack_from(content)
            if channel not in self.topics:
                self._topics_from_summary(channel)
            yield LoggedMessage(self.topics[channel], log_time, content[_MESSAGE.size :])
        elif opcode == Opcode.CHANNEL:
            record = Channel.read(ReadDataStream(BytesIO(content)))
            self.topics[record.id] = record.topic
        elif opcode == Opcode.METADATA:
            entry = Metadata.read(ReadDataStream(BytesIO(content)))
            self.metadata[entry.name] = entry.metadata

    def _topics_from_summary(self, channel: int) -> None:
        """Find the channels in the file's end when the chunk that announced them is lost."""
        with self.path.open("rb") as stream:
            try:
                summary = make_reader(stream).get_summary()
            except _UNREADABLE:
                summary = None
        for record in summary.channels.values() if summary else ():
            self.topics[record.id] = record.topic
        self.topics.setdefault(channel, UNKNOWN_TOPIC)


def check_magic(path: Path, stream: IO[bytes]) -> None:
    """Read the first bytes of a file; a cut-off beginning passes, anything else is refused."""
    begin = stream.read(len(MAGIC))
    if not MAGIC.startswith(begin):
        raise NotARecordingError(
            f"{path} is not an MCAP file: it begins with {begin!r} instead of {MAGIC!r}"
        )


def _unpack(content: bytes) -> bytes:
    """The records in a whole chunk.

    Raises:
        ValueError: the checksum is wrong, or the codec is not one we know.
    """
    _, _, size, checksum, codec, packed = _chunk_parts(content)
    if codec == "zstd":
        data = zstandard.decompress(packed, max_output_size=size)
    elif codec == "":
        data = packed
    else:
        raise ValueError(f"compressed with {codec!r}, known are zstd and none")
    if checksum and zlib.crc32(data) != checksum:
        raise ValueError("its checksum does not match")
    return data


def _unpack_part(content: bytes) -> bytes:
    """As many bytes of a cut chunk as can be had."""
    try:
        *_, codec, packed = _chunk_parts(content)
    except (struct.error, UnicodeDecodeError):
        return b""  # cut inside the chunk's own header: nothing was stored yet
    if codec != "zstd":
        return packed
    try:
        return zstandard.ZstdDecompressor().decompressobj().decompress(packed)
    except zstandard.ZstdError:
        return b""  # not only cut but damaged as well


def _chunk_parts(content: bytes) -> tuple[int, int, int, int, str, bytes]:
    first, last, size, checksum, name_length = _CHUNK.unpack_from(content)
    at = _CHUNK.size + name_length
    codec = content[_CHUNK.size : at].decode()
    (length,) = struct.unpack_from("<Q", content, at)
    return first, last, size, checksum, codec, content[at + 8 : at + 8 + length]
