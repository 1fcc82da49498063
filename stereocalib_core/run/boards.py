"""`stereocalib lidar-camera`: a folder of pictures and clouds to calibration.json, a report and its pictures."""

from __future__ import annotations

from pathlib import Path

import cv2

from stereocalib_core.boards import (
    Answer,
    Calibration,
    Detection,
    PairObservation,
    detect,
    judge,
    open_folder,
    pictures,
    solve,
)
from stereocalib_core.boards.answer import markdown
from stereocalib_core.boards.cloud_files import read_cloud
from stereocalib_core.boards.detect import Progress, in_parallel
from stereocalib_core.boards.findings import findings
from stereocalib_core.boards.folder import read_picture
from stereocalib_core.errors import OutputError, SourceError
from stereocalib_core.files.boards import write_calibration, write_refusals
from stereocalib_core.system.whole_file import write_atomic

FILES = ("calibration.json", "report.md", "residuals.png", "iterations.png", "boards.png", "overlay_*.png")
"""All that a run may write."""


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
    write_calibration(answer, out / "calibration.json")
    write_pictures(found, answer.calibration, out, progress)
    write_atomic(out / "report.md", markdown(answer, files_of(out)))
    return answer


def files_of(out: Path) -> list[Path]:
    """What a run wrote, the overlays as one pattern."""
    return [out / name for name in FILES if name == "report.md" or any(out.glob(name))]


def _write_refusals(found: Detection, error: SourceError, out: Path) -> NothingToSolve:
    """calibration.json and report.md with every pair's reason; the error that says what most of them say."""
    said = findings(found, None)
    write_refusals(found, said, str(error), out / "calibration.json")
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
