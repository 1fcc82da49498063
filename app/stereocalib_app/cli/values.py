"""What options take: each from its text, or a line that says what is wrong with it."""

from __future__ import annotations

import argparse


def frames(text: str) -> tuple[int | None, int | None]:
    first, colon, last = text.partition(":")
    if not colon or not all(part.isdecimal() and len(part) < 10 for part in (first, last) if part):
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is no range A:B")
    return (int(first) if first else None, int(last) if last else None)


def port(text: str) -> int:
    if not text.isdecimal() or not 0 < int(text[:9]) < 65536:
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is no port, 1...65535")
    return int(text)


def token(text: str) -> str:
    if not 8 <= len(text) <= 100 or not all(c.isascii() and (c.isalnum() or c in "-_") for c in text):
        raise argparse.ArgumentTypeError("a token is 8 to 100 letters, digits, - and _")
    return text


def positive(text: str) -> int:
    if not text.isdecimal() or not 0 < int(text[:12]) < 10**9:
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is no positive whole number")
    return int(text)


def kappa(text: str) -> float | None:
    if text == "auto":
        return None
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 1e-6 < value < 1e6:
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is neither auto nor a positive number")
    return value


def frame(text: str) -> int:
    if not text.isdecimal() or len(text) > 9:
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is no frame")
    return int(text)


def size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not all(side.isdecimal() and 32 <= int(side[:6]) <= 16384 for side in (width, height)):
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is no size, e.g. 1242x375")
    return int(width), int(height)


def names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]
