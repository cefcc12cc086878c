"""Messages to bytes and back: MessagePack payload, header in the attachment, everything checked on the way in.

A picture's payload is its pixels as they are; its other fields travel in the attachment beside the header.
"""

from __future__ import annotations

import functools
import zlib
from typing import Any, TypeVar, cast

import msgspec

from common.header import Header
from common.messages import Image, Message, MessageError

M = TypeVar("M", bound=Message)
_ENCODER = msgspec.msgpack.Encoder()

UNDECODABLE = (msgspec.ValidationError, msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""Everything that decoding foreign bytes raises: the last two for text that is no UTF-8 and for endless nesting."""


class Rejected(ValueError):
    """A message that was refused at the door; `reason` is a short name that is counted.

    Args:
        reason: `no header`, `schema`, `malformed` or `content`.
        detail: what was got and what was expected.
    """

    def __init__(self, reason: str, detail: str):
        super().__init__(f"{reason}: {detail}")
        self.reason = reason
        self.detail = detail


@functools.cache
def schema_hash(kind: type[Message]) -> int:
    """32-bit hash of a message type's name, field names and field types, nested messages included."""
    return zlib.crc32(_describe(kind).encode())


def _describe(kind: Any) -> str:
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        fields = msgspec.structs.fields(kind)
        return f"{kind.__name__}({','.join(f'{f.name}:{_describe(f.type)}' for f in fields)})"
    args = getattr(kind, "__args__", ())
    if args:
        return f"{getattr(kind, '__name__', kind)}[{','.join(_describe(a) for a in args)}]"
    return kind.__name__ if isinstance(kind, type) else repr(kind)


@functools.cache
def _decoder(kind: Any) -> msgspec.msgpack.Decoder:
    return msgspec.msgpack.Decoder(kind)


def encode(header: Header, message: Message) -> tuple[bytes, bytes]:
    """Payload and attachment of a message.

    Raises:
        MessageError: the message breaks its own promises (a NaN, a wrong shape): it is not sent.
    """
    message.check()
    if isinstance(message, Image):
        meta = msgspec.structs.replace(message, data=b"")
        return message.data, _ENCODER.encode((header, meta))
    return _ENCODER.encode(message), _ENCODER.encode((header, None))


def decode_header(attachment: bytes | None) -> tuple[Header, Any]:
    """Header of an attachment, and what stands beside it (a picture's fields, or None).

    Raises:
        Rejected: there is none, or it is malformed.
    """
    if not attachment:
        raise Rejected("no header", "got a message without an attachment, expected one written by Outrider")
    try:
        return _decoder(tuple[Header, dict | None]).decode(attachment)
    except UNDECODABLE as error:
        raise Rejected("no header", f"the attachment is no header ({error})") from None


def decode(kind: type[M], payload: bytes, attachment: bytes | None) -> tuple[Header, M]:
    """Header and message of what arrived.

    Raises:
        Rejected: no header, another schema, malformed bytes, or content that breaks the type's promises.
    """
    header, meta = decode_header(attachment)
    expected = schema_hash(kind)
    if header.schema != expected:
        raise Rejected(
            "schema",
            f"{kind.__name__} from {header.source!r} has schema {header.schema:08x}, expected "
            f"{expected:08x}: both sides must run the same version of Outrider",
        )
    try:
        if kind is Image:
            message = cast(M, msgspec.convert({**(meta or {}), "data": payload}, Image))
        else:
            message = _decoder(kind).decode(payload)
        message.check()
    except MessageError as error:
        raise Rejected("content", f"{kind.__name__} from {header.source!r}: {error}") from None
    except (*UNDECODABLE, TypeError) as error:
        raise Rejected("malformed", f"{kind.__name__} from {header.source!r}: {error}") from None
    return header, message
