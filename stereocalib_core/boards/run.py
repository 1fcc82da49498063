"""`stereocalib lidar-camera`: a folder of pictures and clouds to calibration.json and its pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2

from stereocalib_core.boards import pictures, report
from stereocalib_core.boards.answer import Answer, judge, markdown
from stereocalib_core.boards.calibrate import calibrate
from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.boards.cloud_files import read_cloud
from stereocalib_core.boards.detect import Detection, detect, in_parallel
from stereocalib_core.boards.findings import findings
from stereocalib_core.boards.folder import open_folder, read_picture
from stereocalib_core.boards.noise import estimate_noise
from stereocalib_core.boards.observation import PairObservation
from stereocalib_core.errors import OutputError, SourceError
from stereocalib_core.system.whole_file import write_atomic

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
    found = detect(open_folder(Path(folder), pairs, exclude, cropped), progress)
    return judge(found, solve(found, with_intrinsics)).calibration


class NothingToSolve(SourceError):
    """No pair can be used; what became of each is already written."""


def run(
    folder: Path,
    out: Path,
    pairs: list[str] | None = None,
    exclude: list[str] | None = None,
    cropped: bool = False,
    progress: Progress | None = None,
    with_intrinsics: bool = False,
    kappa: float | None = None,
    accept: int | None = None,
) -> Answer:
    """Calibrate a folder and write `calibration.json`, `report.md`, `overlay_NAME.png` and three figures into `out`.

    `out` must exist. A result that must not be trusted is written too: the caller decides how to warn.
    Raises SourceError or ConfigError (one line) before anything is written when the input cannot be used, and
    NothingToSolve, after the refusals are written, when no pair can be. `kappa` [px/m] weighs LiDAR points against
    corners (None: by their own noise).
    """
    found = detect(open_folder(folder, pairs, exclude, cropped), progress)
    if progress is not None:
        progress("solving", 0, 1)
    try:
        answer = judge(found, solve(found, with_intrinsics, kappa), accept)
    except SourceError as error:
        raise _write_refusals(found, error, out) from error
    if progress is not None:
        progress("solving", 1, 1)
    report.write(answer.calibration, out / "calibration.json", found.estimated_rms_px, answer)
    write_pictures(found, answer.calibration, out, progress)
    write_atomic(out / "report.md", markdown(answer, files_of(out)))
    return answer


def solve(
    found: Detection,
    with_intrinsics: bool = False,
    kappa: float | None = None,
    mask: Sequence[bool] | None = None,
) -> Calibration:
    """A detection to a calibration; a camera that was estimated from these boards is refined with the rest."""
    usable = [o for o in found.observations if o.ok]
    noise = estimate_noise(usable, kappa) if usable and kappa is not None else None
    free = with_intrinsics or found.camera_is_estimated
    return calibrate(found.observations, found.board, found.camera, mask, noise, free)


def files_of(out: Path) -> list[Path]:
    """What a run wrote, the overlays as one pattern."""
    named = ("calibration.json", "report.md", "residuals.png", "iterations.png", "boards.png")
    there = [out / name for name in named if (out / name).exists() or name == "report.md"]
    return there + ([out / "overlay_*.png"] if any(out.glob("overlay_*.png")) else [])


def _write_refusals(found: Detection, error: SourceError, out: Path) -> NothingToSolve:
    """calibration.json and report.md with every pair's reason; the error that says what most of them say."""
    said = findings(found, None)
    report.write_refusals(found, said, str(error), out / "calibration.json")
    reasons = [f"- {o.name}: {o.reason}" for o in found.observations]
    causes = [f"**{f.cause}**: {f.remedy}" for f in said]
    write_atomic(
        out / "report.md", "\n".join(["# Camera and LiDAR: nothing to solve", "", *causes, "", *reasons, ""])
    )
    where = out / "calibration.json"
    if not said:
        return NothingToSolve(error.what, error.where, f"{error.remedy} (all reasons: {where})")
    return NothingToSolve(said[0].cause, found.source, f"{said[0].remedy} (all reasons: {where})")


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
