"""The answer in words: what was found, how sure it is, what is in the way and what would mend it.

The same lines stand at the end of the terminal's output and at the top of report.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.boards.detect import Detection
from stereocalib_core.boards.findings import Finding, findings, refused_names
from stereocalib_core.boards.next_pose import NextPose, next_pose
from stereocalib_core.config.boards import FINDING
from stereocalib_core.numeric.arrays import Array

AXES = ("x (right)", "y (down)", "z (forward)")


@dataclass(frozen=True)
class Answer:
    """A judged calibration: the verdict in `calibration.observability` takes the findings into account.

    found: what it rests on. findings: causes and remedies, the worst first. pose: the board to add, if any helps.
    """

    calibration: Calibration
    found: Detection
    findings: tuple[Finding, ...]
    pose: NextPose | None

    @property
    def trusted(self) -> bool:
        """Whether the verdict is good."""
        return self.calibration.verdict == "good"

    @property
    def why(self) -> str:
        """The verdict's reason in one line."""
        return self.calibration.observability.why


def judge(
    found: Detection,
    result: Calibration,
    accept: int | None = None,
    quick: bool = False,
    advise: bool | None = None,
) -> Answer:
    """Findings and verdict together; with `accept` so many agreeing pairs are enough, however many are refused.

    `quick` leaves out the findings that take seconds; `advise` asks for the next pose (None: unless the set is good).
    """
    said = findings(found, result, quick)
    seen = result.observability
    used = sum(p.ok for p in result.pairs)
    refused = len(refused_names(found, result))
    spoilt = [f for f in said if f.spoils]
    if accept is not None and used >= accept and not result.scale.doubted:
        spoilt = []
    elif not spoilt and refused > FINDING.most_refused * (used + refused):
        spoilt = [Finding(f"{refused} of {used + refused} pairs are refused", "see the reason of each pair")]
    if spoilt and seen.verdict == "good":
        seen = replace(seen, verdict="weak", why=f"{spoilt[0]}.")
    elif spoilt and refused > FINDING.most_refused * (used + refused):
        # What the few pairs that are left can see is beside the point, and another board would not mend it.
        seen = replace(seen, why=f"{spoilt[0]}.")
    elif spoilt:
        seen = replace(seen, why=f"{spoilt[0]}. {seen.why}")
    if advise is None:
        advise = seen.verdict != "good"
    pose = next_pose(found.observations, result, found.board) if advise else None
    return Answer(replace(result, observability=seen), found, said, pose)


def lines(answer: Answer, files: Sequence[Path] = ()) -> list[str]:
    """The whole answer as lines of plain text."""
    result = answer.calibration
    used = [p.name for p in result.pairs if p.ok]
    said = [f"verdict: {result.verdict}", f"  {answer.why}", ""]
    said += [
        "T_camera_lidar takes LiDAR points into the camera's optical frame (x right, y down, z forward):"
    ]
    said += _matrix(result.T_camera_lidar)
    said += ["T_lidar_camera takes points of that camera frame into the LiDAR's frame:"]
    said += _matrix(result.T_lidar_camera)
    said += ["", f"1 sigma along and about the camera's axes ({len(used)} boards):"]
    for axis, shift, turn in zip(
        AXES, result.sigma_translation_m, np.rad2deg(result.sigma_rotation_rad), strict=True
    ):
        said.append(f"  {axis:<12} {1000 * shift:7.1f} mm   {turn:6.3f} deg")
    said += ["", *_fit(result), "", *_scale_and_camera(answer), ""]
    said.append(f"{len(used)} of {len(result.pairs)} pairs used: {', '.join(used)}")
    said += [f"  left out: {p.name}: {p.reason}" for p in result.pairs if not p.ok]
    said += [f"note: {note}" for note in answer.found.notes]
    said += [f"{'cause' if f.spoils else 'hint'}: {f.cause}\n  remedy: {f.remedy}" for f in answer.findings]
    if answer.pose is not None:
        said.append(f"next: {answer.pose.words()}")
    if files:
        said += ["", "written: " + ", ".join(str(f) for f in files)]
    return said


def _matrix(T: Array) -> list[str]:
    return ["  " + " ".join(f"{value:11.7f}" for value in row) for row in T]


def _fit(result: Calibration) -> list[str]:
    held = result.held_out
    told = [
        f"cloud points miss their board by {1000 * result.plane_rms_m:.1f} mm rms, corners by "
        f"{result.reprojection_rms_px:.2f} px rms"
    ]
    if np.isfinite(held.plane_rms_m):
        told.append(
            f"a pair that had no say: {1000 * held.plane_rms_m:.1f} mm and {held.reprojection_rms_px:.2f} px rms"
        )
    return told


def _scale_and_camera(answer: Answer) -> list[str]:
    result, board = answer.calibration, answer.found.board
    told = []
    if np.isfinite(result.scale.sigma):
        told.append(
            f"board: {board.square_m:g} m a square; the LiDAR measures {board.square_m * result.scale.value:.4f} "
            f"+- {board.square_m * result.scale.sigma:.4f} m"
        )
    K, sigma = result.camera.K, result.intrinsic_sigma
    source = "as given" if sigma is None else "estimated with the rest"
    told.append(
        f"camera: {result.camera.model}, {source}, fx {K[0, 0]:.2f} fy {K[1, 1]:.2f} "
        f"cx {K[0, 2]:.2f} cy {K[1, 2]:.2f} px"
    )
    if sigma is not None:
        told.append(f"  1 sigma {sigma[0]:.2f}, {sigma[1]:.2f}, {sigma[2]:.2f}, {sigma[3]:.2f} px")
    return told


def markdown(answer: Answer, files: Sequence[Path] = ()) -> str:
    """report.md: the answer, then every pair in a table."""
    table = [
        "| pair | status | plane rms mm | corner rms px | normals deg | reason |",
        "|---|---|---|---|---|---|",
    ]
    for p in answer.calibration.pairs:
        numbers = [
            _cell(1000 * p.plane_rms_m, 1),
            _cell(p.reprojection_rms_px, 2),
            _cell(p.normal_error_deg, 2),
        ]
        reason = p.reason.replace("|", "/")
        table.append(f"| {p.name} | {p.status} | {' | '.join(numbers)} | {reason} |")
    head = ["# Camera and LiDAR", "", "```", *lines(answer, files), "```", "", "## Pairs", ""]
    return "\n".join([*head, *table, "", "`" + answer.calibration.ros2_static_transform() + "`", ""])


def _cell(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else ""
