"""A zip of a drive of any other kind: unpacked, as far as a drive needs it, for as long as the program runs."""

from __future__ import annotations

import atexit
import dataclasses
import shutil
import tempfile
from pathlib import Path

from stereocalib_core.config.reading import (
    MOST_BYTES_OF_AN_ARCHIVE,
    MOST_FILES_OF_AN_ARCHIVE,
    MOST_FOLDERS_OF_A_DRIVE,
    SPARE_BYTES,
)
from stereocalib_core.errors import SourceError, StereoCalibError
from stereocalib_core.frames import FrameSource
from stereocalib_core.sources.archive_files import unpack
from stereocalib_core.sources.format import Format, SourceKind, Spec, parse


def _accepts(spec: Spec) -> bool:
    path = spec.path
    return not spec.scheme and path is not None and path.suffix.lower() == ".zip" and path.is_file()


def drive_in(folder: Path, name: str, options: dict[str, str] | None = None) -> FrameSource:
    """The drive inside an unpacked archive: the folder itself, or the first below it that is one."""
    from stereocalib_core.sources.formats import FORMATS

    first: StereoCalibError | None = None
    for place in [folder, *sorted(p for p in folder.rglob("*") if p.is_dir())][:MOST_FOLDERS_OF_A_DRIVE]:
        spec = dataclasses.replace(parse(str(place)), options=options or {})
        form = next((form for form in FORMATS if form.accepts(spec)), None)
        if form is None or form.kind is SourceKind.RUN:
            continue
        try:
            return form.open(spec)
        except StereoCalibError as error:
            first = first or error
    if first is not None:
        raise first
    raise SourceError("no stereo drive in the zip", name, "pack left/ right/ camera.yaml, or KITTI")


def _open(spec: Spec) -> FrameSource:
    assert spec.path is not None
    folder = Path(tempfile.mkdtemp(prefix="stereocalib-zip-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    room = shutil.disk_usage(folder).free - SPARE_BYTES
    try:
        unpack(
            spec.path,
            spec.name,
            folder,
            min(MOST_BYTES_OF_AN_ARCHIVE, max(room, 0)),
            MOST_FILES_OF_AN_ARCHIVE,
        )
        source = drive_in(folder, spec.name, dict(spec.options))
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    note = f"read from {spec.path.name}"
    if dataclasses.is_dataclass(source) and not isinstance(source, type):
        name = spec.path.stem if source.name == folder.name else source.name
        return dataclasses.replace(source, name=name, notices=(*source.notices, note))  # type: ignore[no-any-return,call-arg]
    return source


FORMAT = Format("zip of a drive", _accepts, _open, SourceKind.ARCHIVE)
