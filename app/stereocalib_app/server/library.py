"""What may be opened: any SOURCE on the command line; from the page only what lies below one root, the synthetic
drive, earlier runs, and small uploads."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path

from stereocalib_app.drive.drive_parts import NO_LIMITS, Limits, judged, part_of
from stereocalib_app.drive.earlier_run import open_run
from stereocalib_app.drive.session import Session
from stereocalib_app.server.inputs import UPLOAD_BYTES
from stereocalib_core.back.analyse import analyse
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import ConfigError, SourceError
from stereocalib_core.files.frame_record import Done
from stereocalib_core.files.io import read_rig
from stereocalib_core.results import Drive, FrameResult
from stereocalib_core.run.calibrate import cut_truth, frame_range
from stereocalib_core.sources import SourceKind, archive_files, open_source, parse, source_kind

UNPACKED_BYTES = 1_000_000_000
UNPACKED_FILES = 8_000
ALL_UPLOADS_BYTES = 2_000_000_000
"""On disk at a time, of all browsers together."""
DRIVE_FOLDERS = (
    *(SourceKind.KITTI_ODOMETRY, SourceKind.KITTI_RAW, SourceKind.KITTI_360, SourceKind.KITTI_PAIRS),
    *(SourceKind.EUROC, SourceKind.FOLDER),
)


def open_drive(
    spec: str,
    config: PipelineConfig,
    frames: tuple[int | None, int | None] = (None, None),
    rig: Path | None = None,
    limits: Limits = NO_LIMITS,
    finished: Sequence[Done] = (),
    door: Callable[[str], str] = str,
) -> Session:
    """Any SOURCE, or the output of an earlier run; raises StereoCalibError in one line.

    limits: what the mount is judged by. finished: frames that need not be computed again. door: what the source that
    an earlier run names may be opened as.
    """
    if source_kind(spec) is SourceKind.RUN:
        return open_run(Path(spec).expanduser().resolve(), limits, door)
    source = open_source(spec)
    if len(source) == 0:
        raise SourceError("drive without frames", spec, "check that it holds pictures")
    start, stop = frame_range(frames, len(source))
    part = part_of(source, start, stop)
    known_rig = None if rig is None else read_rig(rig)

    def whole_drive(results: Sequence[FrameResult]) -> Drive:
        truth = cut_truth(part.ground_truth, 0, len(results))
        return judged(analyse(results, part.camera, config, truth, known_rig), limits)

    whole = (start, stop) == (0, len(source))
    return Session(
        part,
        config,
        spec=spec,
        analyse=whole_drive,
        finished=finished,
        rig=rig,
        frames=None if whole else (start, stop),
    )


class Library:
    """Opens what people ask for on the page, and nothing else."""

    def __init__(
        self,
        root: Path,
        config: PipelineConfig,
        limits: Limits = NO_LIMITS,
        tolerance: Path | None = None,
    ) -> None:
        self.root, self._config, self._limits = root.expanduser().resolve(), config, limits
        self.tolerance = tolerance
        self._uploads: dict[int, Path] = {}

    def resolve(self, text: str) -> str:
        """A source typed on the page; raises SourceError for what lies outside the root."""
        text = text.strip()
        if not text or "\0" in text or len(text) > 1000:
            raise SourceError("empty source", repr(text[:40]), "type a path below the folder named above")
        if text == "synthetic" or text.startswith(("synthetic:", "synthetic?")):
            if "path=" in text:
                raise SourceError("path= is not open to the page", text, "give it on the command line")
            return text
        if text.startswith("video:"):
            raise SourceError("live devices are not open to the page", text, "open them on the command line")
        try:
            path = (self.root / Path(text).expanduser()).resolve()
        except (OSError, RuntimeError) as error:
            raise SourceError("path cannot be read", text[:200], str(error)) from error
        if path != self.root and self.root not in path.parents:
            raise SourceError(
                "outside the folder that the page may read", text[:200], f"stay below {self.root}"
            )
        if parse(str(path)).options:
            # a calibration that is named may lie anywhere, and what cannot be read of it would be said
            raise SourceError("options are not open to the page", text[:200], "give them on the command line")
        return str(path)

    def name_of(self, session: Session) -> str:
        """What to type to open this drive again from the page; empty where the page may not."""
        spec = session.spec if session.run_folder is None else str(session.run_folder)
        try:
            found = self.resolve(spec)
        except SourceError:
            return ""
        return found.replace(f"{self.root}/", "", 1)

    def open(self, text: str) -> Session:
        """What was typed on the page."""
        return open_drive(self.resolve(text), self._config, limits=self._limits, door=self.resolve)

    def vary(self, session: Session, spec: str, same_before: int) -> Session:
        """A variation `spec` of the drive of a session, whose frames before `same_before` are as they were."""
        return open_drive(
            spec,
            session.config,
            session.frames or (None, None),
            session.rig,
            self._limits,
            session.done_before(same_before),
        )

    def open_upload(self, name: str, content: bytes) -> Session:
        """A zip that was uploaded; raises SourceError when it is too large or unsafe. Nothing of it is left then."""
        used = sum(folder_bytes(folder) for folder in self._uploads.values())
        if used + len(content) > ALL_UPLOADS_BYTES:
            words = (
                f"at most {ALL_UPLOADS_BYTES // 1_000_000_000} GB at a time: close a drive that was uploaded"
            )
            raise SourceError("too many uploads", name, words)
        folder = Path(tempfile.mkdtemp(prefix="stereocalib-upload-"))
        try:
            unpack(name, content, folder, ALL_UPLOADS_BYTES - used)
            session = open_drive(str(drive_folder(folder, name)), self._config, limits=self._limits)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        self._uploads[id(session)] = folder
        return session

    def forget(self, session: Session) -> None:
        """A drive is shown no more: remove it where it was uploaded."""
        folder = self._uploads.pop(id(session), None)
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)

    def close(self) -> None:
        """Remove what was uploaded."""
        for folder in self._uploads.values():
            shutil.rmtree(folder, ignore_errors=True)
        self._uploads.clear()


def folder_bytes(folder: Path) -> int:
    """Bytes of all files below a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def unpack(name: str, content: bytes, folder: Path, most_bytes: int = UNPACKED_BYTES) -> None:
    """The parts of a drive in a zip, below `folder`; refuses what is too large, links, and names that lead outside."""
    if len(content) > UPLOAD_BYTES:
        raise SourceError("upload too large", name, f"at most {UPLOAD_BYTES // 1_000_000} MB")
    archive_files.unpack(BytesIO(content), name, folder, min(UNPACKED_BYTES, most_bytes), UNPACKED_FILES)


def drive_folder(folder: Path, name: str) -> Path:
    """The drive inside an unpacked zip: the folder itself or the only one that is a drive."""
    for candidate in [folder, *sorted(p for p in folder.rglob("*") if p.is_dir())][:200]:
        try:
            if source_kind(str(candidate)) in DRIVE_FOLDERS:
                return candidate
        except (SourceError, ConfigError):
            continue
    raise SourceError("no stereo drive in the zip", name, "pack left/ right/ camera.yaml, or KITTI")
