"""Does the boards' sigma hold? `python -m stereocalib_core.experiments.boards_sigma [--seeds FIRST:END] [--pairs N]`

Every seed is a set as `stereocalib synth-boards` renders it, with beams, a printed square and a pattern's place of its
own, found in pictures and clouds and solved as `stereocalib lidar-camera` does it, with K held and refined. Counted is,
along and about every axis of the camera, how many errors lie within one and two sigma (Gaussian: 68 and 95 %).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stereocalib_core.boards.calibrate import calibrate
from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.boards.detect import detect
from stereocalib_core.boards.folder import open_folder
from stereocalib_core.boards.rotations import rotation_vector
from stereocalib_core.boards.synth import T_CAMERA_LIDAR, SynthSettings, write_set
from stereocalib_core.numeric.arrays import Array

AXES = ("turn x", "turn y", "turn z", "x", "y", "z")
FRESH = range(600, 660)
"""Seeds that no number was chosen on (the noise model's were 100 to 159)."""


@dataclass(frozen=True)
class Coverage:
    """errors, sigmas: (N, 6) of N sets: rotation vector about the camera's axes [rad], translation [m]."""

    errors: Array
    sigmas: Array

    def within(self, sigmas: float) -> Array:
        """(6,) share of the errors within so many sigma."""
        return np.asarray(np.mean(np.abs(self.errors) <= sigmas * self.sigmas, axis=0))

    def rms(self) -> Array:
        """(6,) root mean square of error over sigma; 1 where sigma holds."""
        return np.asarray(np.sqrt(np.mean((self.errors / self.sigmas) ** 2, axis=0)))


def error_of(result: Calibration) -> Array:
    """(6,) rotation vector about the camera's axes [rad] and translation [m] from the truth of `synth-boards`."""
    turn = rotation_vector(result.T_camera_lidar[:3, :3] @ T_CAMERA_LIDAR[:3, :3].T)
    return np.concatenate([turn, result.T_camera_lidar[:3, 3] - T_CAMERA_LIDAR[:3, 3]])


def solved(seed: int, pairs: int) -> tuple[Calibration, Calibration]:
    """One rendered set: with the intrinsics of its camera.yaml held, and refined."""
    with tempfile.TemporaryDirectory() as scratch:
        write_set(Path(scratch), SynthSettings(pairs=pairs, seed=seed))
        found = detect(open_folder(Path(scratch)))
    held, refined = (
        calibrate(found.observations, found.board, found.camera, with_intrinsics=free)
        for free in (False, True)
    )
    return held, refined


def measure(seeds: Sequence[int], pairs: int = SynthSettings().pairs) -> tuple[Coverage, Coverage]:
    """Coverage with the intrinsics held and refined; a line on stderr as each set is done."""
    errors, sigmas = np.zeros((2, len(seeds), 6)), np.zeros((2, len(seeds), 6))
    for done, seed in enumerate(seeds):
        for kind, result in enumerate(solved(seed, pairs)):
            errors[kind, done], sigmas[kind, done] = error_of(result), np.sqrt(np.diag(result.covariance))
        sys.stderr.write(f"\rset {done + 1} of {len(seeds)}")
    sys.stderr.write("\n")
    return Coverage(errors[0], sigmas[0]), Coverage(errors[1], sigmas[1])


def table(held: Coverage, refined: Coverage) -> str:
    """As Markdown: per cent within one and two sigma, and the rms of error over sigma, for every axis."""
    lines = [
        f"{len(held.errors)} rendered sets",
        "",
        "| intrinsics | | " + " | ".join(AXES) + " | all |",
        "|---" * (len(AXES) + 3) + "|",
    ]
    for name, coverage in (("fixed", held), ("refined", refined)):
        for sigmas in (1.0, 2.0):
            shares = 100 * coverage.within(sigmas)
            cells = " | ".join(f"{share:.0f}" for share in (*shares, shares.mean()))
            lines.append(f"| {name} | within {sigmas:.0f} sigma [%] | {cells} |")
        rms = coverage.rms()
        cells = " | ".join(f"{value:.2f}" for value in (*rms, np.sqrt(np.mean(rms**2))))
        lines.append(f"| {name} | rms of error / sigma | {cells} |")
    return "\n".join(lines) + "\n"


def main(words: Sequence[str] | None = None) -> None:
    """Render, solve, count, print."""
    parser = argparse.ArgumentParser(prog="boards_sigma", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", default=f"{FRESH.start}:{FRESH.stop}", help="FIRST:END, END not included")
    parser.add_argument("--pairs", type=int, default=SynthSettings().pairs, help="boards in a set")
    arguments = parser.parse_args(words)
    first, end = (int(word) for word in arguments.seeds.split(":"))
    sys.stdout.write(table(*measure(range(first, end), arguments.pairs)))


if __name__ == "__main__":
    main()
