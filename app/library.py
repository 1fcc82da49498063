"""What may be opened from the page: paths below one root, the synthetic drive, earlier runs, small uploads."""

from __future__ import annotations

import importlib
import importlib.util
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path, PurePosixPath

import numpy as np

from app.session import Session
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import ConfigError, Failure, FailureReason, SourceError
from stereocalib_core.frames import FrameSource, GroundTruth, Recording, StereoFrame
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.io import SavedRun, read_rig, read_run
from stereocalib_core.results import DriveAnalysis, FilteredExtrinsics, FrameResult, RoadEstimate
from stereocalib_core.run import cut_truth, frame_range
from stereocalib_core.sources import SourceKind, open_source, source_kind

UPLOAD_BYTES = 200_000_000
UNPACKED_BYTES = 1_000_000_000
UNPACKED_FILES = 8_000
DRIVE_FOLDERS = (SourceKind.KITTI_ODOMETRY, SourceKind.KITTI_RAW, SourceKind.FOLDER)


def part_of(source: FrameSource, start: int, stop: int) -> FrameSource:
    """Frames start...stop - 1 of a drive as a drive of its own."""
    if (start, stop) == (0, len(source)):
        return source

    def load(index: int) -> StereoFrame:
        return replace(source[start + index], index=index)

    return Recording(
        source.name,
        source.camera,
        source.timestamps_s[start:stop],
        load,
        cut_truth(source.ground_truth, start, stop),
        source.notices,
        source.T_camera_lidar,
        f"{source.content_key}:{start}:{stop}",
    )


def open_drive(
    spec: str,
    config: PipelineConfig,
    frames: tuple[int | None, int | None] = (None, None),
    rig: Path | None = None,
) -> Session:
    """Any SOURCE, or the output of an earlier run; raises StereoCalibError in one line."""
    if source_kind(spec) is SourceKind.RUN:
        return open_run(Path(spec).expanduser().resolve())
    source = open_source(spec)
    if len(source) == 0:
        raise SourceError("drive without frames", spec, "check that it holds pictures")
    start, stop = frame_range(frames, len(source))
    part = part_of(source, start, stop)
    known_rig = None if rig is None else read_rig(rig)

    def whole_drive(results: Sequence[FrameResult]) -> DriveAnalysis | None:
        if importlib.util.find_spec("stereocalib_core.drive") is None:
            return None
        analyse = importlib.import_module("stereocalib_core.drive").analyse
        truth = cut_truth(part.ground_truth, 0, len(results))
        return analyse(results, part.camera, config, truth, known_rig)

    whole = (start, stop) == (0, len(source))
    return Session(
        part, config, spec=spec, analyse=whole_drive, rig=rig, frames=None if whole else (start, stop)
    )


def open_run(folder: Path) -> Session:
    """An earlier run: its results as they were written, its pictures where the source is still there."""
    run = read_run(folder)
    results = saved_results(run)
    if not results:
        raise SourceError("run without frames", folder, "run it again")
    times = np.array([r.timestamp_s for r in results])
    first = int(np.asarray(run.extrinsics["frame"])[0])
    spec = str(run.report.get("source", ""))
    try:
        whole = open_source(spec)
        stop = min(first + len(results), len(whole))
        source = part_of(whole, first, stop)
        results = results[: len(source)]
    except SourceError as error:
        source = without_pictures(folder, times, str(error))
    analysis = DriveAnalysis(run.report, saved_filter(run), run.poses, run.rig)
    config = PipelineConfig(method="paper" if run.report.get("method") == "paper" else "direct")
    return Session(
        source, config, spec=str(folder), finished=results, analyse=lambda _results: analysis, saved=True
    )


def without_pictures(folder: Path, times: np.ndarray, why: str) -> FrameSource:
    """A drive of which only the numbers are left."""
    failure = Failure(FailureReason.MISSING_PAIR, "the pictures of this run are not at hand")

    def load(index: int) -> StereoFrame:
        return StereoFrame(index, float(times[index]), None, None, failure)

    camera = StereoCamera(1226, 370, 707.09, 601.89, 183.11, 0.537)
    return Recording(folder.name, camera, times, load, GroundTruth(), (f"pictures not found: {why}",))


def saved_results(run: SavedRun) -> tuple[FrameResult, ...]:
    """extrinsics.csv back as results, without tracks."""
    columns = run.extrinsics
    results = []
    for i, status in enumerate(columns["status"]):
        numbers = [float(columns[name][i]) for name in ("height_m", "pitch_deg", "roll_deg")]
        names = ("height_sigma_m", "pitch_sigma_deg", "roll_sigma_deg")
        sigma = np.array([float(columns[name][i]) for name in names])
        sigma[1:] = np.deg2rad(sigma[1:])
        free = float(columns["free_fraction"][i])
        inliers = columns["inliers"][i]
        count = int(inliers) if np.isfinite(inliers) else 0
        road = failure = None
        if status == "ok":
            road = RoadEstimate(
                Extrinsics.from_degrees(*numbers),
                np.diag(sigma**2),
                count,
                free,
                (float("nan"), float("nan")),
            )
        else:
            failure = Failure(FailureReason(columns["reason"][i]), "as written by the run")
        results.append(FrameResult(i, float(columns["timestamp_s"][i]), road, failure, free, count))
    return tuple(results)


def saved_filter(run: SavedRun) -> FilteredExtrinsics:
    """The filtered columns of extrinsics.csv."""
    c = run.extrinsics
    angles = [np.deg2rad(c[f"{axis}_filtered_deg"]) for axis in ("pitch", "roll")]
    values = np.stack([c["height_filtered_m"], *angles], axis=1)
    spread = [np.deg2rad(c[f"{axis}_filtered_sigma_deg"]) for axis in ("pitch", "roll")]
    sigma = np.stack([c["height_filtered_sigma_m"], *spread], axis=1)
    return FilteredExtrinsics(values, np.einsum("ni,ij->nij", sigma**2, np.eye(3)), tuple(c["filter_state"]))


class Library:
    """Opens what people ask for on the page, and nothing else."""

    def __init__(self, root: Path, config: PipelineConfig) -> None:
        self.root, self._config = root.expanduser().resolve(), config
        self._uploads: list[Path] = []

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
        return str(path)

    def open(self, text: str) -> Session:
        """What was typed on the page."""
        return open_drive(self.resolve(text), self._config)

    def open_upload(self, name: str, content: bytes) -> Session:
        """A zip that was uploaded; raises SourceError when it is too large or unsafe."""
        folder = Path(tempfile.mkdtemp(prefix="stereocalib-upload-"))
        self._uploads.append(folder)
        unpack(name, content, folder)
        return open_drive(str(drive_folder(folder)), self._config)

    def close(self) -> None:
        """Remove what was uploaded."""
        for folder in self._uploads:
            shutil.rmtree(folder, ignore_errors=True)
        self._uploads.clear()


def unpack(name: str, content: bytes, folder: Path) -> None:
    """A zip below `folder`; refuses what is too large, links, and names that lead outside."""
    if len(content) > UPLOAD_BYTES:
        raise SourceError("upload too large", name, f"at most {UPLOAD_BYTES // 1_000_000} MB")
    try:
        with zipfile.ZipFile(BytesIO(content)) as archive:
            entries = archive.infolist()
            if len(entries) > UNPACKED_FILES or sum(e.file_size for e in entries) > UNPACKED_BYTES:
                raise SourceError("zip unpacks to too much", name, "at most 8000 files and 1 GB")
            for entry in entries:
                path = PurePosixPath(entry.filename.replace("\\", "/"))
                link = stat.S_ISLNK(entry.external_attr >> 16)
                if path.is_absolute() or ".." in path.parts or ":" in entry.filename or link:
                    raise SourceError(
                        "zip with an unsafe name", entry.filename[:100], "pack plain files only"
                    )
            for entry in entries:
                if entry.is_dir():
                    continue
                target = folder / PurePosixPath(entry.filename.replace("\\", "/"))
                target.parent.mkdir(parents=True, exist_ok=True)
                with archive.open(entry) as source:
                    data = source.read(entry.file_size + 1)
                if len(data) > entry.file_size:
                    raise SourceError("zip lies about its size", name, "pack it again")
                target.write_bytes(data)
    except (zipfile.BadZipFile, OSError, NotImplementedError, RuntimeError) as error:
        raise SourceError("zip cannot be read", name, str(error)) from error


def drive_folder(folder: Path) -> Path:
    """The drive inside an unpacked zip: the folder itself or the only one that is a drive."""
    for candidate in [folder, *sorted(p for p in folder.rglob("*") if p.is_dir())][:200]:
        try:
            if source_kind(str(candidate)) in DRIVE_FOLDERS:
                return candidate
        except (SourceError, ConfigError):
            continue
    raise SourceError("no stereo drive in the zip", folder.name, "pack left/ right/ camera.yaml, or KITTI")
