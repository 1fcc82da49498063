"""What most pairs say together: one cause and one remedy, in place of twenty reasons.

Each finder looks at a detection (and its calibration, when there is one) and answers with a `Finding` or nothing. The
first is the one to mend first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.detect import Detection
from stereocalib_core.boards.intrinsics import estimate_camera
from stereocalib_core.boards.second_opinion import intrinsics_of
from stereocalib_core.boards.shuffled import shuffled_clouds
from stereocalib_core.config.boards import FINDING
from stereocalib_core.errors import SourceError


@dataclass(frozen=True)
class Finding:
    """cause: what is wrong, with its numbers. remedy: what to do. spoils: whether the result must not be trusted."""

    cause: str
    remedy: str
    spoils: bool = True

    def __str__(self) -> str:
        return f"{self.cause}: {self.remedy}"


def findings(found: Detection, result: Calibration | None, quick: bool = False) -> tuple[Finding, ...]:
    """Everything worth saying, the worst first; empty for a sound set. `quick` asks what takes milliseconds only."""
    answers = [finder(found, result) for finder in _FINDERS if not (quick and finder in _SLOW)]
    said = [a for a in answers if a is not None]
    if not any(f.spoils for f in said) and (common := most_common_reason(found, result)) is not None:
        said.append(common)
    return tuple(sorted(said, key=lambda f: not f.spoils))


def refused_names(found: Detection, result: Calibration | None) -> dict[str, str]:
    """NAME to reason of every pair that had no say, those that were left out on purpose apart."""
    if result is None:
        return {o.name: o.reason for o in found.observations if not o.ok}
    return {p.name: p.reason for p in result.pairs if not p.ok and p.reason != "left out"}


def _most_refused(found: Detection, result: Calibration | None) -> bool:
    return len(refused_names(found, result)) > FINDING.most_refused * len(found.observations)


def wrong_size(found: Detection, result: Calibration | None) -> Finding | None:
    """Pictures of another size than camera.yaml says."""
    sizes = Counter(
        words.split()[2].rstrip(":")
        for words in refused_names(found, result).values()
        if words.startswith("picture is ")
    )
    if not sizes or sum(sizes.values()) < FINDING.most_refused * len(found.observations):
        return None
    size = sizes.most_common(1)[0][0]
    camera = found.camera
    across, down = (float(n) for n in size.split("x"))
    factors = across / camera.width, down / camera.height
    remedy = "give the camera.yaml of these pictures"
    if abs(factors[0] - factors[1]) < FINDING.same_scale * factors[0]:
        remedy = f"multiply K by {factors[0]:.4g} and write width: {across:.0f}, height: {down:.0f}"
    return Finding(f"the pictures are {size}, camera.yaml is for {camera.width}x{camera.height}", remedy)


def wrong_camera(found: Detection, result: Calibration | None) -> Finding | None:
    """K of another resolution, or another lens model: held against a camera estimated from the same corners."""
    if found.camera_is_estimated:
        return None
    given = found.camera
    corners = [o.corners for o in found.observations if o.corners is not None]
    rms = np.array([o.corner_rms_px for o in found.observations if o.corners is not None])
    if len(corners) < FINDING.least_pictures:
        return None
    missed = float(np.median(np.nan_to_num(rms, nan=np.inf)))
    scale = _principal_point_scale(given)
    doubted = result is not None and result.doubt is not None and result.doubt.beyond_chance
    if missed < FINDING.fair_rms_px and scale is None and not doubted:
        return None
    try:
        own, own_rms = estimate_camera(corners, (given.width, given.height), found.board)
    except SourceError:
        return None
    ratio = float(np.sqrt(own.K[0, 0] * own.K[1, 1] / (given.K[0, 0] * given.K[1, 1])))
    if scale is not None and abs(np.log(ratio * scale)) < FINDING.same_focal:
        width, height = given.width * scale, given.height * scale
        return Finding(
            f"K is for pictures of about {width:.0f}x{height:.0f}, these are {given.width}x{given.height} (its "
            f"centre lies at {given.K[0, 2]:.0f}, {given.K[1, 2]:.0f}, and the boards ask for a focal length of "
            f"{own.K[0, 0]:.0f} px in place of {given.K[0, 0]:.0f})",
            f"multiply K by {1 / scale:.4g}",
        )
    if missed > FINDING.clearly_worse * own_rms and missed > FINDING.fair_rms_px:
        text = f"{missed:.1f} px" if np.isfinite(missed) else "by far"
        return Finding(
            f"the lens in camera.yaml ({given.model}) does not fit these pictures: corners miss it by {text}, a "
            f"{own.model} with focal length {own.K[0, 0]:.0f} px fits them to {own_rms:.2f} px",
            "check model, K and D of camera.yaml, or write model: estimate",
        )
    if abs(np.log(ratio)) > FINDING.same_focal and result is not None and result.doubt is not None:
        return Finding(
            f"the boards ask for a focal length of {own.K[0, 0]:.0f} px, camera.yaml says {given.K[0, 0]:.0f}",
            "check K of camera.yaml, or write model: estimate",
        )
    return None


def _principal_point_scale(camera: BoardCamera) -> float | None:
    """The picture size that K's centre is the middle of, over the stated one, when it is clearly another one."""
    across, down = 2 * camera.K[0, 2] / camera.width, 2 * camera.K[1, 2] / camera.height
    scale = float(np.sqrt(max(across * down, 1e-12)))
    same = abs(across - down) < FINDING.same_centre * scale
    return scale if same and abs(np.log(scale)) > FINDING.other_size else None


def wrong_square(found: Detection, result: Calibration | None) -> Finding | None:
    """The printed square, as the LiDAR measures it."""
    if result is None or not result.scale.doubted:
        return None
    stated = found.board.square_m
    return Finding(
        f"the boards measure {stated * result.scale.value:.4f} +- {stated * result.scale.sigma:.4f} m a square in "
        f"the LiDAR, board.yaml says {stated:g}",
        "measure the printed squares with a ruler and correct square_m (the result goes by the LiDAR)",
    )


def mixed_up_clouds(found: Detection, result: Calibration | None) -> Finding | None:
    """Clouds that fit other pictures than their own."""
    if not _most_refused(found, result):
        return None
    swapped = shuffled_clouds(found)
    if not swapped:
        return None
    few = ", ".join(f"cloud {cloud} with picture {picture}" for cloud, picture in list(swapped.items())[:4])
    return Finding(
        f"{len(swapped)} of {len(found.observations)} clouds fit other pictures than those of their own name ({few})",
        "give clouds the names of their pictures",
    )


def most_common_reason(found: Detection, result: Calibration | None) -> Finding | None:
    """What most of the refused pairs have in common, where nothing better is known."""
    if not _most_refused(found, result):
        return None
    kinds = Counter(_kind(reason) for reason in refused_names(found, result).values())
    kind, count = kinds.most_common(1)[0]
    return Finding(
        f"{kind} ({count} of {len(found.observations)} pairs)", _REMEDIES.get(kind, "see the pairs")
    )


def _kind(reason: str) -> str:
    for beginning, kind in _KINDS.items():
        if reason.startswith(beginning):
            return kind
    return reason.split(":")[0]


def doubtful_intrinsics(found: Detection, result: Calibration | None) -> Finding | None:
    """A camera that the boards would have otherwise, by more than chance; sigma already carries it."""
    if (
        result is None
        or result.doubt is None
        or not result.doubt.beyond_chance
        or result.intrinsic_sigma is not None
    ):
        return None
    own, given = intrinsics_of(result.doubt.camera)[:4], intrinsics_of(result.camera)[:4]
    worst = int(np.argmax(np.abs(own - given)))
    name = ("fx", "fy", "cx", "cy")[worst]
    return Finding(
        f"the boards ask for another K or lens than camera.yaml has ({name} {own[worst]:.1f} px in place of "
        f"{given[worst]:.1f}); sigma allows for it",
        "calibrate the camera anew, or try --intrinsics refine",
        spoils=False,
    )


def thin_intrinsics(found: Detection, result: Calibration | None) -> Finding | None:
    """A camera that comes from these boards alone, when they are few or all near the middle of the picture."""
    if result is None or result.intrinsic_sigma is None:
        return None
    ok = {p.name for p in result.pairs if p.ok}
    corners = [o.corners for o in found.observations if o.name in ok and o.corners is not None]
    if not corners:
        return None
    area = ConvexHull(np.concatenate(corners)).volume / (result.camera.width * result.camera.height)
    few, central = len(corners) < FINDING.least_lens_pictures, area < FINDING.least_covered
    if not (few or central):
        return None
    return Finding(
        f"the camera is estimated from {len(corners)} boards that span {100 * area:.0f} % of the picture",
        f"show the board in at least {FINDING.least_lens_pictures} pictures, also at their edges and tilted, or give K",
    )


_FINDERS: tuple[Callable[[Detection, Calibration | None], Finding | None], ...] = (
    wrong_size, wrong_camera, mixed_up_clouds, wrong_square, thin_intrinsics,
    doubtful_intrinsics,
)  # fmt: skip
_SLOW = (wrong_camera, mixed_up_clouds)
_KINDS = {
    "edge-on": "the board is seen edge-on",
    "wrong pair": "picture and cloud do not show the same pose",
    "no board in the cloud where": "no board in the cloud where the picture has it",
    "no board in the cloud": "no board in the cloud",
    "no board of": "no board in the picture",
    "corners miss": "corners do not fit the board",
    "no pose fits": "corners do not fit the board",
}
_REMEDIES = {
    "picture and cloud do not show the same pose": "take both while the board stands still, under the same name",
    "no board in the cloud where the picture has it": "take picture and cloud while the board stands still; check the "
    "size of the board in board.yaml",
    "no board in the cloud": "hold the board free of walls and people, nearer to the LiDAR; check width_m and "
    "height_m in board.yaml",
    "the board is seen edge-on": "hold it so that camera and LiDAR both see its face; noise of several "
    "centimetres on a small board looks the same: take a larger one",
    "no board in the picture": "count the inner corners again (columns, rows); the whole pattern must be seen, sharp",
    "corners do not fit the board": "check camera.yaml and board.yaml",
    "no picture of this name": "give picture and cloud the same name",
    "no cloud of this name": "give picture and cloud the same name",
    "cloud is not in metres": "write x y z in metres, in the sensor's own frame",
}
