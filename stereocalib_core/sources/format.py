"""What a format is: how it is recognised and how it is opened; and a SOURCE taken apart."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from urllib.parse import parse_qsl

from stereocalib_core.errors import SourceError
from stereocalib_core.frames import FrameSource

SCHEMES = ("synthetic", "video", "bag")


class SourceKind(Enum):
    """What a SOURCE turned out to be."""

    KITTI_ODOMETRY = "KITTI odometry sequence"
    KITTI_RAW = "KITTI raw drive"
    KITTI_360 = "KITTI-360 drive"
    KITTI_PAIRS = "KITTI stereo or object pairs"
    EUROC = "EuRoC / ASL recording"
    FOLDER = "plain folder"
    ARCHIVE = "zip of a drive"
    BAG = "ROS bag or MCAP"
    SYNTHETIC = "synthetic drive"
    VIDEO = "video"
    RUN = "output of an earlier run"


@dataclass(frozen=True)
class Spec:
    """A SOURCE as it was written, taken apart.

    scheme: `video`, `bag`, `synthetic`, or empty for a path. path: the file or folder, None where it is none.
    options: what follows the `?`.
    """

    text: str
    scheme: str
    name: str
    path: Path | None
    options: Mapping[str, str] = field(default_factory=dict)

    @property
    def folder(self) -> Path | None:
        """The path where it is a folder."""
        return self.path if self.path is not None and self.path.is_dir() else None


@dataclass(frozen=True)
class Format:
    """One kind of recording.

    accepts: whether a SOURCE is one, told from a look at names, cheap and without an exception.
    open: the recording; raises SourceError in one line.
    """

    title: str
    accepts: Callable[[Spec], bool]
    open: Callable[[Spec], FrameSource]
    kind: SourceKind = SourceKind.FOLDER


def absolute(spec: str) -> Path:
    """The full path as it was named. What lies beside a link (calibration, poses) comes before what lies beside
    its target, so links stay; but `..` means the folder above the target."""
    path = Path(spec).expanduser()
    return path.resolve() if ".." in path.parts else path.absolute()


def parse(text: str) -> Spec:
    """A SOURCE taken apart; raises SourceError for one that cannot be a path."""
    if not text or "\0" in text:
        raise SourceError("empty source", repr(text), "name a folder, synthetic, or video:FILE")
    for scheme in SCHEMES:
        if text == scheme or text.startswith((f"{scheme}:", f"{scheme}?")):
            rest = text[len(scheme) :].removeprefix(":")
            name, _, query = rest.partition("?") if scheme == "synthetic" else _split(rest)
            path = _path(name) if scheme == "bag" and name else None
            # a synthetic drive reads its own keys: `fault` may come several times
            options = {} if scheme == "synthetic" else _options(query, text, f"bad {scheme} source")
            return Spec(text, scheme, name, path, options)
    name, _, query = _split(text)
    return Spec(text, "", name, _path(name), _options(query, text, "bad source"))


def _split(text: str) -> tuple[str, str, str]:
    """Name and options; a `?` that belongs to a file's own name stays in it."""
    name, mark, query = text.rpartition("?")
    try:
        whole = Path(text).expanduser().exists()
    except OSError:
        whole = False
    return (name, mark, query) if mark and "=" in query and not whole else (text, "", "")


def _path(name: str) -> Path:
    try:
        return absolute(name)
    except (OSError, RuntimeError) as error:
        raise SourceError("path cannot be read", name[:200], str(error)) from error


def _options(query: str, text: str, what: str) -> dict[str, str]:
    pairs = parse_qsl(query, keep_blank_values=True)
    options = dict(pairs)
    if len(options) != len(pairs):
        raise SourceError(what, text, "give every option once")
    return options


def with_option(text: str, key: str, value: str) -> str:
    """A SOURCE with one option more, `?key=value` or `&key=value`; replaces the one it has."""
    from urllib.parse import quote

    spec = parse(text)
    options = {**spec.options, key: value}
    head = text if not spec.options else text.rpartition("?")[0]
    return head + "?" + "&".join(f"{name}={quote(text, safe='/:,.@-_+')}" for name, text in options.items())
