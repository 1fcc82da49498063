"""Which of two cameras a name speaks of: left/right, L/R, cam0/cam1, image_02/image_03, 1/2."""

from __future__ import annotations

import re
from dataclasses import dataclass

_WORDS = re.compile(r"(?i)(?<![a-z])(left|right|lft|rgt|l|r)(?![a-z])|(?i:left|right)")
_WORD_INSIDE = re.compile(r"(left|right|Left|Right|LEFT|RIGHT)")
_CAMERA = re.compile(
    r"(?i)^(.*?(?:cam|camera|image|images|img|imgs|im|view|sensor|infra|infra_|mono|grey|gray|color|colour|rgb|data)[_\-.]?)"
    r"(0*[0-9])(?![0-9])(.*)$"
)
_BARE = re.compile(r"^(0*[0-3])$")


@dataclass(frozen=True)
class Side:
    """index: 0 left, 1 right. rest: the name without its side, equal for both cameras. token: what told it."""

    index: int
    rest: str
    token: str


def side_of(name: str) -> Side | None:
    """The side a name speaks of; None where it speaks of none."""
    match = _WORDS.search(name) or _WORD_INSIDE.search(name)
    if match is not None:
        word = match.group(0).lower()
        rest = f"{name[: match.start()]}*{name[match.end() :]}".lower()
        return Side(int(word.startswith("r")), rest, "word")
    match = _CAMERA.match(name)
    if match is not None:
        number = int(match.group(2))
        # 0 and 1, 2 and 3 are pairs as in KITTI; 1 and 2 are one where there is no 0 (see `camera_number`)
        return Side(number % 2, f"{match.group(1)}{number // 2}*{match.group(3)}".lower(), "number")
    return None


def camera_number(name: str) -> tuple[int, str] | None:
    """The camera's number in a name and the name without it: cam1 -> (1, `cam*`); None where there is none."""
    match = _CAMERA.match(name)
    if match is not None:
        return int(match.group(2)), f"{match.group(1)}*{match.group(3)}".lower()
    match = _BARE.match(name)
    return None if match is None else (int(match.group(1)), "*")
