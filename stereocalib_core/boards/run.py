"""A folder of pictures and clouds of a chessboard to a calibration: for scripts, and what every caller solves by."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from stereocalib_core.boards.answer import judge
from stereocalib_core.boards.calibrate import calibrate
from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.boards.detect import Detection, Progress, detect
from stereocalib_core.boards.folder import open_folder
from stereocalib_core.boards.noise import estimate_noise


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
    return judge(found, solve(found, with_intrinsics), advise=False).calibration


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
