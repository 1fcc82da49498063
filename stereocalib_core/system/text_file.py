"""Text that strangers wrote: any usual encoding, never more of it than its content justifies."""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Iterator
from pathlib import Path

from stereocalib_core.errors import SourceError, StereoCalibError

_BOMS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")


def size_text(size: int) -> str:
    """A number of bytes as it is said: 256 kB, 64 MB."""
    return f"{size >> 20} MB" if size >= 1 << 20 else f"{size >> 10} kB"


def read_text(path: Path, most_bytes: int, what: str, error: type[StereoCalibError] = SourceError) -> str:
    """The text of a file of at most `most_bytes`, whatever its encoding; raises `error` in one line.

    No more than `most_bytes` are ever read, however large the file is or claims to be.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(most_bytes + 1)
    except OSError as reason:
        raise error(f"{what} cannot be read", path, reason.strerror or "check the file") from reason
    if len(data) > most_bytes:
        raise error(f"{what} too large", path, f"at most {size_text(most_bytes)} are read")
    return decoded(data, path, what, error)


def decoded(data: bytes, where: object, what: str, error: type[StereoCalibError] = SourceError) -> str:
    """Bytes to text: UTF-8, UTF-16 or UTF-32 with their mark, UTF-16 without, else Latin-1."""
    name = next((name for mark, name in _BOMS if data.startswith(mark)), None)
    if name is None and data[:200].count(0) > len(data[:200]) // 3:
        name = "utf-16-be" if data[:1] == b"\0" else "utf-16-le"
    try:
        text = data.decode(name or "utf-8")
    except UnicodeDecodeError:
        if name is not None:
            raise error(f"{what} is no text", where, "save it as UTF-8") from None
        text = data.decode("latin-1")
    if "\0" in text:
        raise error(f"{what} is no text", where, "save it as UTF-8")
    return text


def to_number(word: object) -> float | None:
    """A number, or a word that is one (`7.07e2`, `7,07`), as a finite float; None for anything else."""
    if isinstance(word, bool) or word is None:
        return None
    if isinstance(word, str):
        word = word.strip()
        if _DECIMAL_COMMA.fullmatch(word):
            word = word.replace(",", ".")
        if len(word) > 64 or "_" in word:
            return None
    try:
        value = float(word)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return None
    return value if math.isfinite(value) else None


def to_numbers(text: str) -> list[float] | None:
    """All numbers of a text separated by blanks, commas or semicolons, decimal commas understood; None where
    one word is none."""
    words = text.replace("[", " ").replace("]", " ").replace(";", " ").split()
    if not all(_DECIMAL_COMMA.fullmatch(word) or "," not in word for word in words):
        words = " ".join(words).replace(",", " ").split()
    values = [to_number(word) for word in words]
    return None if any(value is None for value in values) else values  # type: ignore[return-value]


LONGEST_LINE = 4096
"""A row of 17 numbers in full is 400 characters."""


def lines(
    path: Path, most_bytes: int, what: str, error: type[StereoCalibError] = SourceError
) -> Iterator[str]:
    """The lines of a text file without their ends, one at a time, whatever its encoding.

    Raises `error` in one line for a file that cannot be read, is longer than `most_bytes`, or has a line that no
    list has.
    """
    try:
        with open(path, "rb") as raw:
            start = raw.read(200)
        name = next((name for mark, name in _BOMS if start.startswith(mark)), None)
        if name is None and start.count(0) > len(start) // 3:
            name = "utf-16-be" if start[:1] == b"\0" else "utf-16-le"
        seen = 0
        with open(path, encoding=name or "utf-8", errors="replace") as file:
            while line := file.readline(LONGEST_LINE + 1):
                if len(line) > LONGEST_LINE:
                    raise error(f"{what} is no list", path, f"a line of over {LONGEST_LINE} characters")
                seen += len(line)
                if seen > most_bytes:
                    raise error(f"{what} too large", path, f"at most {size_text(most_bytes)} are read")
                yield line.rstrip("\r\n")
    except (OSError, UnicodeError) as reason:
        text = getattr(reason, "strerror", None) or "save it as UTF-8"
        raise error(f"{what} cannot be read", path, text) from reason
