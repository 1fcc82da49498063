"""Camera to 3-D LiDAR by chessboard planes (Zheng et al. 2018, and beyond it).

`detect` looks at every picture and cloud once; `calibrate` solves for any choice of the pairs in
milliseconds; `judge` says what may be trusted.
"""

import numpy as np

from stereocalib_core.boards.answer import Answer, judge, lines
from stereocalib_core.boards.calibrate import calibrate, ticked_mask
from stereocalib_core.boards.calibration import Calibration, HeldOut, PairResult
from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.detect import Detection, detect
from stereocalib_core.boards.folder import BoardFolder, open_folder
from stereocalib_core.boards.joint import Noise
from stereocalib_core.boards.memo import Memo, state_of
from stereocalib_core.boards.observability import Observability
from stereocalib_core.boards.observation import BoardSpec, PairObservation, PlaneEstimate
from stereocalib_core.boards.outline import overlaps
from stereocalib_core.boards.pcd import lzf_decompress
from stereocalib_core.boards.point_sums import warm_up as warm_up_sums
from stereocalib_core.boards.refine import Iteration
from stereocalib_core.boards.run import solve

__all__ = [
    "Answer", "BoardCamera", "BoardFolder", "BoardSpec", "Calibration", "Detection", "HeldOut", "Iteration", "Memo",
    "Noise", "Observability", "PairObservation", "PairResult", "PlaneEstimate", "calibrate", "detect",
    "judge", "lines", "open_folder", "solve", "state_of", "ticked_mask", "warm_up",
]  # fmt: skip


def warm_up() -> None:
    """Compile what is compiled: the outline search, the refinement's sums, the unpacker of compressed PCD files."""
    warm_up_sums()
    lzf_decompress(np.array([0, 7], dtype=np.uint8), 1)
    overlaps(np.zeros((1, 2)), np.ones(1, dtype=bool), np.ones(2), 0.0, np.zeros(1), np.zeros((1, 2)))
