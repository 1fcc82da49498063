"""Recordings of every kind behind one door: `open_source(spec)`. The formats are the table in `formats/`."""

from __future__ import annotations

from pathlib import Path

from stereocalib_core.errors import SourceError
from stereocalib_core.frames import FrameSource
from stereocalib_core.sources.format import Format, SourceKind, Spec, absolute, parse, with_option
from stereocalib_core.sources.prefetch import prefetch

__all__ = [
    "Format",
    "SourceKind",
    "Spec",
    "absolute",
    "format_of",
    "open_source",
    "parse",
    "prefetch",
    "source_kind",
    "with_calibration",
]


def format_of(spec: Spec) -> Format:
    """The first format of the table that accepts a SOURCE; raises SourceError, with what is missing, for none."""
    from stereocalib_core.sources.formats import FORMATS

    for form in FORMATS:
        if form.accepts(spec):
            return form
    raise SourceError(*_no_drive(spec))


def source_kind(spec: str) -> SourceKind:
    """What `spec` is, by what is in it; raises SourceError for what is none of the kinds."""
    return format_of(parse(spec)).kind


def open_source(spec: str) -> FrameSource:
    """Open any SOURCE but the output of an earlier run; raises SourceError in one line."""
    import cv2

    taken = parse(spec)
    form = format_of(taken)
    # Damaged pictures are reported as failed frames, not as lines on stderr.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return form.open(taken)


def with_calibration(spec: str, calibration: str | Path | None) -> str:
    """A SOURCE that takes this calibration in place of its own; raises SourceError for one that has none to replace."""
    if calibration is None:
        return spec
    if parse(spec).scheme == "synthetic":
        raise SourceError("no calibration to replace", spec, "a rendered drive knows its own")
    files = [str(absolute(part)) for part in str(calibration).split(",")]
    return with_option(spec, "calibration", ",".join(files))


def _no_drive(spec: Spec) -> tuple[str, object, str]:
    """What, where and what to do for a path that no format accepts."""
    path = spec.path
    if spec.scheme or path is None:
        return "no such source", spec.text, "see `stereocalib run --help`"
    try:
        if path.is_dir():
            return "no stereo drive", path, _nearest_remedy(path)
        if path.exists():
            return "a file, no folder", path, "name the folder of the drive, or video:FILE?camera=YAML"
    except OSError as error:
        return "path cannot be read", path, error.strerror or "check the path"
    return "no such folder", spec.name[:200], "check the path"


def _nearest_remedy(path: Path) -> str:
    """What is missing to the kind of folder this resembles most."""
    try:
        names = {entry.name for entry in path.iterdir()}
    except OSError as error:
        return f"it cannot be read: {error.strerror or 'check its rights'}"
    if not names:
        return "the folder is empty"
    if any(not (path / name).exists() for name in names):
        dead = next(name for name in sorted(names) if not (path / name).exists())
        return f"{dead} is a link to nothing"
    if "calib.txt" in names and not any(name.startswith("image_") for name in names):
        return "calib.txt is there but no image_0"
    if any(name.startswith("image_") or name == "oxts" for name in names):
        there = ", ".join(sorted(name for name in names if name.startswith("image_")))
        return f"pictures of both cameras are needed, found {there or 'none'}"
    if {name.lower() for name in names} & {"left", "right"}:
        return "left/ and right/ need pictures on both sides"
    if "sequences" in names:
        return "name one sequence of it, e.g. sequences/00"
    if any("_drive_" in name for name in names):
        return "name one drive of it"
    return "expected image_0 image_1 calib.txt, image_00 image_01, or left right camera.yaml"


def warm_up() -> None:
    """Compile what this package compiles."""
    from stereocalib_core.sources import png

    png.warm_up()
