"""`stereocalib lidar-camera`: a folder of pictures and clouds to calibration.json and its pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2

from stereocalib_core.boards import pictures, report
from stereocalib_core.boards.calibrate import calibrate
from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.boards.cloud_files import read_cloud
from stereocalib_core.boards.detect import Detection, detect, in_parallel
from stereocalib_core.boards.folder import open_folder, read_picture
from stereocalib_core.boards.observation import PairObservation
from stereocalib_core.errors import OutputError, SourceError

Progress = Callable[[str, int, int], None]


def calibrate_boards(
    folder: str | Path,
    *,
    pairs: list[str] | None = None,
    exclude: list[str] | None = None,
    cropped: bool = False,
    with_intrinsics: bool = False,
    progress: Progress | None = None,
) -> Calibration:
    """Where a LiDAR stands to a camera, from a folder of pictures and clouds of a chessboard.

    pairs, exclude: names of the pairs to take or to leave; None = all. cropped: take `clouds_cropped/`.
    with_intrinsics: refine the camera's own calibration too. Raises SourceError or ConfigError (one line).
    """
    return _solved(Path(folder), pairs, exclude, cropped, progress, with_intrinsics)[1]


def run(
    folder: Path,
    out: Path,
    pairs: list[str] | None = None,
    exclude: list[str] | None = None,
    cropped: bool = False,
    progress: Progress | None = None,
    with_intrinsics: bool = False,
) -> Calibration:
    """Calibrate a folder and write `calibration.json`, `overlay_NAME.png` and three figures into `out`.

    `out` must exist. A result whose `degenerate` is True is written too: the caller decides how to warn.
    Raises SourceError or ConfigError (one line) before anything is written when the input cannot be used.
    """
    found, result = _solved(folder, pairs, exclude, cropped, progress, with_intrinsics)
    report.write(result, out / "calibration.json", found.estimated_rms_px)
    write_pictures(found, result, out, progress)
    return result


def _solved(
    folder: Path,
    pairs: list[str] | None,
    exclude: list[str] | None,
    cropped: bool,
    progress: Progress | None,
    with_intrinsics: bool,
) -> tuple[Detection, Calibration]:
    """What was seen, and what it says."""
    found = detect(open_folder(folder, pairs, exclude, cropped), progress)
    if progress is not None:
        progress("solving", 0, 1)
    result = calibrate(found.observations, found.board, found.camera, with_intrinsics=with_intrinsics)
    if progress is not None:
        progress("solving", 1, 1)
    return found, result


def write_pictures(
    found: Detection, result: Calibration, out: Path, progress: Progress | None = None
) -> None:
    """Cloud over picture for each pair that has both, and the three figures."""
    shown = [o for o in found.observations if o.image is not None and o.cloud is not None]
    in_parallel(lambda o: _write_overlay(o, found, result, out), shown, "drawing pictures", progress)
    pictures.residual_figure(result).savefig(out / "residuals.png", dpi=100)
    if result.iterations:
        pictures.iteration_figure(result).savefig(out / "iterations.png", dpi=100)
        pictures.boards_figure(result, found.observations, found.board).savefig(out / "boards.png", dpi=100)


def _write_overlay(o: PairObservation, found: Detection, result: Calibration, out: Path) -> None:
    assert o.image is not None and o.cloud is not None, "only complete pairs are drawn"
    try:
        picture, points = read_picture(o.image, found.camera), read_cloud(o.cloud)
    except SourceError:
        # An unreadable half of a pair has already been reported with its reason.
        return
    drawn = pictures.before_and_after(picture, points, result, o, found.board)
    target = out / f"overlay_{o.name}.png"
    if not cv2.imwrite(str(target), drawn, [cv2.IMWRITE_PNG_COMPRESSION, 3]):
        raise OutputError("picture cannot be written", target, "check the folder and the disk")
