"""What all dialects share: names of lens models, checks of matrices, units of a baseline."""

from __future__ import annotations

import numpy as np

from stereocalib_core.calibration import Lens, LensPair, Model, RectifiedPair, Size
from stereocalib_core.config.reading import (
    LARGEST_BASELINE_M,
    LARGEST_CONVERTED_M,
    LEAST_BASELINE_M,
    MOST_BASELINE_M,
    SAME_FOCAL,
    SIDEWAYS,
    SMALLEST_CONVERTED_M,
)
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import Array

PINHOLE_NAMES = (
    *("pinhole", "plumb_bob", "radtan", "radtan5", "radtan8", "radial_tangential", "brown", "brown_conrady"),
    *(
        "modified_brown_conrady",
        "rational",
        "rational8",
        "rational_polynomial",
        "opencv",
        "opencv5",
        "opencv8",
    ),
    *("thin_prism", "tilted", "perspective", "rectified", "none"),
)
FISHEYE_NAMES = (
    *(
        "fisheye",
        "equidistant",
        "equi",
        "kannala_brandt",
        "kannala_brandt4",
        "kannalabrandt",
        "kannalabrandt8",
    ),
    *("kb", "kb4", "kb8", "opencv_fisheye"),
)


def lens_model(name: object, where: object) -> Model:
    """`pinhole` or `fisheye` for every usual name of a lens model; raises SourceError for others."""
    plain = str(name if name is not None else "pinhole").strip().lower().replace("-", "_").replace(" ", "_")
    if plain in FISHEYE_NAMES:
        return "fisheye"
    if plain in PINHOLE_NAMES or not plain:
        return "pinhole"
    known = "use pinhole (plumb_bob, radtan, rational) or fisheye (equidistant)"
    raise SourceError(f"unknown model {plain[:30]}", where, known)


def lens(K: Array, D: Array, model: Model, where: object) -> Lens:
    """A checked lens from (9,) K and (n,) D."""
    K = np.array(K, dtype=np.float64).reshape(3, 3)
    if K[0, 0] <= 0 or K[1, 1] <= 0 or K[2, 2] != 1 or np.any(K[[1, 2, 2], [0, 0, 1]] != 0):
        raise SourceError("K is no camera matrix", where, "expected [[fx, s, cx], [0, fy, cy], [0, 0, 1]]")
    lengths = (0, 1, 2, 3, 4, 5, 8, 12, 14) if model == "pinhole" else (0, 1, 2, 3, 4)
    if len(D) not in lengths and np.any(D[4:]):
        raise SourceError(f"{model} distortion of {len(D)} numbers", where, f"expected one of {lengths}")
    D = D[:4] if len(D) not in lengths else D
    return Lens(K, Lens(K, np.array(D, dtype=np.float64), model).padded(), model)


def lens_pair(left: Lens, right: Lens, R: Array, t: Array, size: Size | None, where: object) -> LensPair:
    """A checked pair from R (9,), t (3,) of right from left, t in metres."""
    R, t = np.array(R, dtype=np.float64).reshape(3, 3), np.array(t, dtype=np.float64).ravel()
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0:
        raise SourceError("R is no rotation", where, "expected an orthonormal 3x3 matrix of right from left")
    baseline = float(np.linalg.norm(t))
    if t[0] >= 0 or abs(t[0]) < SIDEWAYS * baseline or not LEAST_BASELINE_M < baseline < MOST_BASELINE_M:
        remedy = "the right camera must lie to the right of the left one, t[0] < 0 in metres"
        raise SourceError(f"t is {np.round(t, 4).tolist()}", where, remedy)
    if left.model != right.model:
        raise SourceError("lens models differ", where, "both cameras must be pinhole or both fisheye")
    return LensPair(left, right, R, t, size)


def rectified_or_lenses(
    P_left: Array, P_right: Array, size: Size | None, where: object
) -> RectifiedPair | LensPair:
    """Two (3, 4) projections [px, px m] as a rectified pair; as ideal lenses where fx and fy differ."""
    focal, cx, cy = P_left[0, 0], P_left[0, 2], P_left[1, 2]
    if not (focal > 0 and P_left[1, 1] > 0 and P_right[0, 0] > 0 and P_right[1, 1] > 0):
        remedy = "P must be [f 0 cx fb; 0 f cy 0; 0 0 1 0]"
        raise SourceError("calibration without a focal length", where, remedy)
    if abs(P_right[0, 0] / focal - 1) > SAME_FOCAL:
        raise SourceError("focal lengths differ", where, "the pictures must be rectified to one camera")
    baseline = float(P_left[0, 3] / focal - P_right[0, 3] / P_right[0, 0])
    check_baseline(baseline, where)
    if abs(P_left[1, 1] / focal - 1) > SAME_FOCAL:
        lenses = [Lens(P[:, :3].copy(), np.zeros(4)) for P in (P_left, P_right)]
        return LensPair(lenses[0], lenses[1], np.eye(3), np.array([-baseline, 0.0, 0.0]), size)
    cx_right = float(P_right[0, 2])
    return RectifiedPair(
        float(focal), float(cx), float(cy), baseline, None if cx_right == cx else cx_right, size
    )


def check_baseline(baseline_m: float, where: object) -> None:
    """Raise SourceError for a baseline that no pair has, its sign included."""
    if not LEAST_BASELINE_M < baseline_m < MOST_BASELINE_M:
        remedy = "the right camera must lie to the right of the left one"
        raise SourceError(f"baseline of {baseline_m:g} m", where, remedy)


def metres(value: float, where: object, unit: str | None = None) -> tuple[float, str | None]:
    """The factor that makes a stated baseline metres, and a note where one had to be chosen.

    Raises SourceError where centimetres and millimetres are both possible. unit: what the user says it is.
    """
    factors = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
    if unit is not None:
        return factors[unit], None
    if abs(value) <= LARGEST_BASELINE_M:
        return 1.0, None
    possible = [
        name for name in ("cm", "mm")
        if SMALLEST_CONVERTED_M <= abs(value) * factors[name] <= LARGEST_CONVERTED_M
    ]  # fmt: skip
    if len(possible) == 1:
        name = possible[0]
        return factors[
            name
        ], f"baseline of {abs(value):.6g} taken as {name}: {abs(value) * factors[name]:.6g} m"
    if possible:
        remedy = (
            f"write it in metres, {abs(value) / 100:.6g} or {abs(value) / 1000:.6g}, or say SOURCE?unit=cm"
        )
        raise SourceError(f"baseline of {abs(value):.6g} m, in cm or mm?", where, remedy)
    raise SourceError(f"baseline of {abs(value):.6g} m", where, "write baseline_m in metres")
