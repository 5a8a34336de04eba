"""A motion file's bytes and its text.

Files do not say their encoding. It is told from their bytes: UTF-8 if they are that; else the one
of ``_EAST_ASIAN`` in which most characters are among that language's common ones; else Latin-1,
which reads anything. Whichever it is, text written in it again has the same bytes, so a wrong guess
loses nothing; the readers' ``encoding=`` overrules it, and ``Skeleton.encoding`` keeps it.

It must be known before the text is taken apart: second bytes of Shift-JIS and GBK are those of
``{``, ``}`` and the backslash.
"""

import codecs
import re
from os import PathLike

from jaxmotion.io.errors import MotionFileError

_END_MARK = re.compile(rb"\x1a[\x1a\x00\s]*\Z")
_LONGEST_TAIL = 256
_COMMON_SHARE = 0.6
# Kana, marks and the first level of kanji; Hangul; the first level of hanzi, which contains the
# bytes of Hangul: from and to which first byte, and from which second byte.
_EAST_ASIAN = {
    "cp932": (0x81, 0x98, 0x40),
    "cp949": (0xB0, 0xC8, 0xA1),
    "gbk": (0xB0, 0xD7, 0xA1),
}


def plain_bytes(path: str | PathLike, data: bytes) -> bytes:
    """The bytes without a byte-order mark and a DOS end-of-file mark, in an encoding that contains
    ASCII (UTF-8 for UTF-16), with line feeds.

    **Raises:** :class:`~jaxmotion.io.MotionFileError` for UTF-16 that is none.
    """
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        try:
            data = data.decode("utf-16").encode("utf-8")
        except UnicodeError:
            raise MotionFileError(
                path, "bytes that are not the UTF-16 they claim to be", expected="text", line=1
            ) from None
    data = data.removeprefix(codecs.BOM_UTF8)
    if mark := _END_MARK.search(data, max(len(data) - _LONGEST_TAIL, 0)):
        data = data[: mark.start()]
    return data if b"\n" in data else data.replace(b"\r", b"\n")


def decoded(path: str | PathLike, data: bytes, encoding: str | None = None) -> tuple[str, str]:
    """The text of ``data`` and its encoding, told from the bytes unless it is given.

    **Raises:** :class:`~jaxmotion.io.MotionFileError` for bytes that the given encoding has no text
    for; ``ValueError`` for an encoding that is unknown or does not contain ASCII.
    """
    if encoding is None:
        return _told(data)
    try:
        contains_ascii = "HIERARCHY {}".encode(encoding) == b"HIERARCHY {}"
    except LookupError:
        contains_ascii = False
    if not contains_ascii:
        raise ValueError(f"load: encoding={encoding!r}; expected one such as 'gbk' or 'cp1252'")
    text = _strictly(data, encoding)
    if text is None:
        raise MotionFileError(
            path, f"bytes that are no {encoding} text", expected="the encoding that was asked for"
        )
    return text, encoding


def encoding_for(text: str, wanted: str) -> str:
    """The encoding ``wanted`` if text written in it will be read as it is, else UTF-8."""
    try:
        return wanted if _told(text.encode(wanted)) == (text, wanted) else "utf-8"
    except (ValueError, LookupError):
        return "utf-8"


def _told(data: bytes) -> tuple[str, str]:
    text = _strictly(data, "utf-8")
    if text is not None:
        return text, "utf-8"
    found = [(_common_share(data, name), name) for name in _EAST_ASIAN]
    share, name = max(found, key=lambda entry: entry[0])
    name = name if share > _COMMON_SHARE else "latin-1"
    return data.decode(name), name


def _strictly(data: bytes, encoding: str) -> str | None:
    """The text, if it is encoded as the same bytes again."""
    try:
        text = data.decode(encoding)
        return text if text.encode(encoding) == data else None
    except UnicodeError:
        return None


def _common_share(data: bytes, encoding: str) -> float:
    """How many of the characters beyond ASCII are common ones; 0 for other bytes than text."""
    text = _strictly(data, encoding)
    pairs = [c.encode(encoding) for c in text or "" if not c.isascii()]
    if all(pair[-1] < 0x80 for pair in pairs):  # such as Peter’s in cp1252
        return 0.0
    first, last, least = _EAST_ASIAN[encoding]
    common = [first <= pair[0] <= last and pair[1] >= least for pair in pairs if len(pair) == 2]
    return sum(common) / len(pairs)
