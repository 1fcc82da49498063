"""Why a frame fails, in plain words: the likely cause and what to do, by reason."""

from __future__ import annotations

from typing import Final

from stereocalib_core.errors import FailureReason

REMEDIES: Final[dict[FailureReason, tuple[str, str]]] = {
    FailureReason.UNREADABLE: (
        "the picture file is damaged or cut off",
        "copy it again from the recording; the other frames are not affected",
    ),
    FailureReason.SIZE_MISMATCH: (
        "left and right have different sizes, or not the camera's",
        "check that both files belong to this rig and were not resized",
    ),
    FailureReason.MISSING_PAIR: (
        "one camera has no picture here",
        "a frame was dropped while recording: check disk speed and triggering",
    ),
    FailureReason.DARK: (
        "the picture is nearly black: night, tunnel, or a covered lens",
        "raise exposure or gain; look whether the lens is covered",
    ),
    FailureReason.SATURATED: (
        "large parts are white: glare or over-exposure",
        "lower the exposure; shade the lens",
    ),
    FailureReason.FLAT_TEXTURE: (
        "there is nothing to match: fog, snow, a wall, dirt on the lens",
        "clean the lens; elsewhere on the drive the road will show again",
    ),
    FailureReason.FROZEN: (
        "a camera repeats its last picture",
        "check the camera's link and the recorder's buffers",
    ),
    FailureReason.SWAPPED: (
        "left and right are exchanged: everything seems to lie behind the camera",
        "exchange the two folders, or the cables",
    ),
    FailureReason.MISALIGNED: (
        "the rows of the two pictures do not match: one camera has turned",
        "recalibrate the stereo pair; see the rows of the pair in Inspect",
    ),
    FailureReason.NO_DISPARITY: (
        "hardly any pixel found its partner",
        "check focus and exposure of both cameras, and that they trigger together",
    ),
    FailureReason.NO_ROAD: (
        "no free road of this car lies ahead: a truck, a wall, a crossing car, or a step up or down",
        "nothing to mend when the view was really blocked",
    ),
    FailureReason.NOT_PLANAR: (
        "what is free does not lie on one plane: a ramp, a kerb, grass; or poor matching by night, rain, dirt",
        "nothing to mend on a ramp; else see in disparity and free map what leaks in",
    ),
    FailureReason.TOO_UNCERTAIN: (
        "too little road, or too little texture on it, to be sure",
        "a longer free stretch or more light helps",
    ),
    FailureReason.OUT_OF_RANGE: (
        "the plane found cannot be the road under this camera",
        "check baseline and focal length of the calibration",
    ),
    FailureReason.INCONSISTENT: (
        "a plane was measured, but not the road of the frames around: a lawn, a pavement, a crossing street",
        "nothing to mend; if the rig was moved just here, frames on both sides must show it",
    ),
    FailureReason.CALIBRATION: (
        "pictures and calibration do not belong together: another size, crop or focal length",
        "use the calibration of these very pictures, or scale it with them",
    ),
    FailureReason.UNSYNCHRONISED: (
        "left and right were not taken at the same moment",
        "trigger both cameras together; shift one list of pictures by the lag that is named",
    ),
}

UPSIDE_DOWN: Final[dict[FailureReason, tuple[str, str]]] = {
    FailureReason.SWAPPED: (
        "the pictures are upside down: what is near lies above, and everything seems to lie behind the camera",
        "turn both pictures by half a turn; left and right stay as they are",
    ),
    FailureReason.NO_ROAD: (
        "the pictures are upside down: what is near lies above",
        "turn both pictures by half a turn and exchange left and right; flip them where they are mirrored",
    ),
}
"""The same where what a picture has nearest lies in its upper part."""
