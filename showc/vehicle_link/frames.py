"""MAVLink frames out of datagrams, and their signatures."""

from __future__ import annotations

import hashlib
import hmac
import re
import time
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from showc.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

GROUND_SYSTEM = 255
"""System id of a ground station."""

GROUND_COMPONENT = 190
"""Component id of a ground station: MAV_COMP_ID_MISSIONPLANNER."""

SECOND = 0xFD
"""First byte of a frame of MAVLink 2."""

MARKER = re.compile(rb"[\xfd\xfe]")
"""First byte of a frame of MAVLink 2 or 1."""

SIGNED = 0x01
"""Flag of a frame that ends with a signature."""

SIGNATURE_BYTES = 13
"""Link, 48-bit time stamp, 48-bit signature."""

KEY_BYTES = 32
"""Length of a signing key: one SHA-256."""

FALSE_STARTS = 32
"""Bytes that look like the start of a frame and are none, after which the rest of a
datagram is not searched: noise must not take the time of setpoints."""

LONGEST_FRAME = 255 + 12 + SIGNATURE_BYTES
"""Bytes of the longest frame."""

SIGNING_EPOCH = 1_420_070_400
"""Start of signing's time stamps, 2015-01-01 UTC [s since 1970]."""

STAMPS_PER_SECOND = 100_000
"""Signing's time stamps are tens of microseconds."""

OLDEST_STAMP = 60 * STAMPS_PER_SECOND
"""A stream that is new may lie this far behind the present (MAVLink's guide)."""


def read_key(path: Path) -> bytes:
    """Return the signing key that a file holds.

    The file holds 64 hexadecimal digits, or a passphrase: its key is the SHA-256 of the
    passphrase, as in other ground stations.

    Raises
    ------
    UsageError
        If the file cannot be read or is empty.
    """
    try:
        text = path.read_text(encoding="utf-8").strip("\r\n")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: the signing key cannot be read ({error})") from None
    if not text.strip():
        raise UsageError(
            f"{path}: is empty; wanted a signing key of 64 hexadecimal digits, or a "
            "passphrase"
        )
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b""
    return key if len(key) == KEY_BYTES else hashlib.sha256(text.encode()).digest()


class Codec:
    """Packs own messages, and takes those of others apart.

    Parameters
    ----------
    key
        Signing key of 32 bytes: own messages carry a signature, and messages without a
        right one are not taken. None: neither.
    """

    def __init__(self, key: bytes | None = None) -> None:
        # The dialect is generated code without types.
        self._out: Any = dialect.MAVLink(None, GROUND_SYSTEM, GROUND_COMPONENT)
        self._in: Any = dialect.MAVLink(None, GROUND_SYSTEM, GROUND_COMPONENT)
        self._key = key
        self._stamps: dict[tuple[int, int, int], int] = {}
        if key is not None:
            self._out.signing.secret_key = key
            self._out.signing.sign_outgoing = True

    def pack(self, message: Any) -> bytes:  # noqa: ANN401 - generated, without types
        """Return the next frame with ``message``."""
        if self._key is not None:
            signing = self._out.signing
            signing.timestamp = max(signing.timestamp, _now())
        data: bytes = message.pack(self._out)
        self._out.seq = (self._out.seq + 1) % 256
        return data

    def message(self, frame: bytes) -> Any:  # noqa: ANN401 - generated, without types
        """Return the message of a frame; None if it is not known or damaged."""
        try:
            message = self._in.decode(bytearray(frame))
        except dialect.MAVError:
            return None
        known = message.get_msgId() in dialect.mavlink_map
        return message if known else None

    def trusted(self, frame: bytes) -> bool:
        """Return whether a frame has the signature that is asked for, if one is.

        The signature is checked before the time stamp is heeded: a forged frame must
        not lock the vehicle out.
        """
        if self._key is None:
            return True
        if frame[0] != SECOND or not frame[2] & SIGNED:
            return False
        right = hashlib.sha256(self._key + frame[:-6]).digest()[:6]
        if not hmac.compare_digest(right, frame[-6:]):
            return False
        stamp = int.from_bytes(frame[-12:-6], "little")
        stream = (frame[-13], frame[5], frame[6])
        if stamp <= self._stamps.get(stream, _now() - OLDEST_STAMP):
            return False
        self._stamps[stream] = stamp
        return True


class Framer:
    """Finds whole frames in the datagrams of one sender.

    A datagram usually holds whole frames. What is left of a half one is kept for the
    next datagram, and dropped when that one begins with a frame of its own.
    """

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        self.kept = b""
        """Beginning of a frame whose rest has not come."""

    def feed(self, data: bytes) -> list[tuple[Any, bytes]]:
        """Return the messages that are whole now, each with its frame."""
        if self.kept:
            found, rest = self._scan(data)
            if not found or not MARKER.match(data):
                found, rest = self._scan(self.kept + data)
        else:
            found, rest = self._scan(data)
        self.kept = rest
        return found

    def _scan(self, data: bytes) -> tuple[list[tuple[Any, bytes]], bytes]:
        """Whole messages in ``data``, and the beginning of a frame at its end."""
        found: list[tuple[Any, bytes]] = []
        rest, place = b"", 0
        for _ in range(FALSE_STARTS):
            while (start := MARKER.search(data, place)) is not None:
                place = start.start()
                length = _length(data, place)
                if place + length > len(data):
                    rest = rest or data[place:]
                    break
                frame = data[place : place + length]
                message = self._codec.message(frame)
                if message is None:
                    break
                found.append((message, frame))
                place, rest = place + length, b""
            if start is None:
                break
            place += 1
        return found, rest


def _length(data: bytes, place: int) -> int:
    """Bytes of the frame that begins at ``place``, as far as its header is there."""
    if place + 3 > len(data):
        return LONGEST_FRAME
    second = data[place] == SECOND
    signed = second and data[place + 2] & SIGNED
    return (12 if second else 8) + data[place + 1] + (SIGNATURE_BYTES if signed else 0)


def _now() -> int:
    """Present time as signing counts it."""
    return int((time.time() - SIGNING_EPOCH) * STAMPS_PER_SECOND)
