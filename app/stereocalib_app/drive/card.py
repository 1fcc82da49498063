"""The answer first: how the camera is mounted, as rows that become a card on the page or lines of text."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from stereocalib_app.drive.session import Snapshot
from stereocalib_app.widgets import text
from stereocalib_app.widgets.card import CardRow, card
from stereocalib_core.frames import GroundTruth
from stereocalib_core.results import ANGLES, Drive, LidarShift, Shift

MOUNT = (
    ("height", "height_m", " m"),
    ("pitch", "pitch_rad", "°"),
    ("roll", "roll_rad", "°"),
    ("yaw", "yaw_rad", "°"),
)
DIGITS = 3
SHIFTS_SHOWN = 6


def plain_units(line: str) -> str:
    """A line of the report in the page's spelling: ±, °, a real minus, and no sign before a nought."""
    line = re.sub(r"[+-](?=0\.0+(?![\d.]))", "", line.replace("+-", "±"))
    return line.replace(" deg", "°").replace("-0.", "−0.")


def shift_words(shift: Shift | LidarShift) -> str:
    """A shift of the mount in words."""
    value, unit = (float(np.rad2deg(shift.size)), "°") if shift.axis in ANGLES else (shift.size, " m")
    sign = "" if shift.size < 0 else "+"
    return f"{shift.kind} of {shift.axis} {sign}{text.number(value, 3, unit)} at frame {shift.frame}"


def limit_words(drive: Drive, axis: str, factor: float, unit: str) -> tuple[str, bool]:
    """The verdict on one axis, and whether it is bad."""
    limit, within = drive.limits.get(axis), drive.within(axis)
    if limit is None:
        return "", False
    allowed = f"{factor * limit.nominal:g} ± {factor * limit.tolerance:g}{unit}".replace("-", "−")
    if within is None:
        return f"not measured, allowed {allowed}", True
    return (f"✓ within {allowed}", False) if within else (f"✗ OUTSIDE {allowed}", True)


def mount_rows(drive: Drive) -> list[CardRow]:
    """The lines of the card of an analysed drive."""
    rows = []
    for name, axis, unit in MOUNT:
        found = getattr(drive.mount, axis)
        factor = float(np.rad2deg(1.0)) if axis.endswith("_rad") else 1.0
        value = "–"
        if found is not None:
            value = text.with_sigma(factor * found.value, factor * found.sigma, DIGITS, unit)
        elif name == "yaw" and drive.yaw_reason:
            value = f"not known: {plain_units(drive.yaw_reason)}"
        rows.append(CardRow(name, value, *limit_words(drive, axis, factor, unit)))
    if drive.limits:
        within = drive.within_tolerance
        words = "✓ mount within tolerance" if within else "✗ mount OUTSIDE tolerance"
        if within is None:
            words = "not every axis measured"
        rows.append(CardRow("tolerance", words, bad=not within))
    if drive.mount.note is not None:
        rows.append(CardRow("mount", drive.mount.note, bad=True))
    rows.append(CardRow("stereo pair", drive.pair.verdict, bad=drive.pair.verdict != "good"))
    shifts = [shift_words(shift) for shift in drive.shifts]
    more = f"; and {len(shifts) - SHIFTS_SHOWN} more" if len(shifts) > SHIFTS_SHOWN else ""
    rows.append(CardRow("shifts", "; ".join(shifts[:SHIFTS_SHOWN]) + more or "none", bad=bool(shifts)))
    return rows


def median_rows(snapshot: Snapshot) -> list[CardRow]:
    """Medians over the frames computed so far, until the whole drive is analysed."""
    roads = [r.road.extrinsics for r in snapshot.results if r.road is not None]
    if not roads:
        return [CardRow(name, "–") for name, *_ in MOUNT[:3]]
    values = np.array([(e.height_m, e.pitch_deg, e.roll_deg) for e in roads])
    middle, spread = np.median(values, axis=0), values.std(axis=0)
    return [
        CardRow(
            name, f"{text.number(middle[i], DIGITS, unit)} (spread {text.number(spread[i], DIGITS, unit)})"
        )
        for i, (name, _key, unit) in enumerate(MOUNT[:3])
    ]


def card_rows(snapshot: Snapshot) -> tuple[str, list[CardRow]]:
    """Title and lines of the card."""
    if snapshot.drive is not None and snapshot.drive.mount.height_m is not None:
        state = "" if snapshot.done else ", so far"
        return f"How this camera is mounted{state}", mount_rows(snapshot.drive)
    return "How this camera is mounted, median so far", median_rows(snapshot)


def pair_words(snapshot: Snapshot) -> str:
    """What the rows of left and right say of the pair, or nothing."""
    return "" if snapshot.drive is None else plain_units(snapshot.drive.pair.why)


def truth_words(truth: GroundTruth | None) -> str:
    """What the truth of a recording is good for, in one place."""
    if truth is None or (truth.poses is None and truth.extrinsics is None):
        return "Truth: none in this recording; paths are told by their length alone."
    parts = []
    if truth.poses is not None:
        whole = "the whole path, position and heading"
        length = "the length of the path only (its heading is not reliable), so no error of position is shown"
        parts.append(whole if truth.heading_reliable else length)
    if truth.extrinsics is not None:
        parts.append("height, pitch, roll and yaw of every frame")
    return f"Truth: good for {'; '.join(parts)}."


TWO_NUMBERS = (
    "The mount above is what the whole drive says, each frame weighted by its σ and the car's own motion taken out; "
    "the medians below are of single pairs, with that motion in them."
)


def lidar_rows(drive: Drive) -> list[CardRow]:
    """Camera against LiDAR, where there are scans."""
    if drive.lidar is None:
        return []
    check = drive.lidar
    degrees = float(np.rad2deg(1.0))
    parts = [
        f"{name} {text.with_sigma(factor * r.median, factor * r.scatter, 3, unit)}"
        for name, r, factor, unit in (
            ("height", check.height_m, 1.0, " m"),
            ("pitch", check.pitch_rad, degrees, "°"),
            ("roll", check.roll_rad, degrees, "°"),
        )
        if r is not None
    ]
    by_road = ", ".join(parts) + f" ({check.frames} frames, ± scatter)" if parts else "no frame shows both"
    rows = [CardRow("LiDAR − stereo", by_road)]
    shifts = "; ".join(shift_words(shift) for shift in check.shifts)
    return [*rows, CardRow("LiDAR shifts", shifts or "none", bad=bool(shifts))]


def pair_rows(drive: Drive) -> list[CardRow]:
    """The pair's own calibration, as far as it was measured."""
    pair, degrees = drive.pair, float(np.rad2deg(1.0))
    kinds = (
        ("relative pitch", pair.relative_pitch_rad, degrees, "°"),
        ("relative roll", pair.relative_roll_rad, degrees, "°"),
        ("relative yaw", pair.relative_yaw_rad, degrees, "°"),
        ("disparity offset", pair.disparity_offset_px, 1.0, " px"),
        ("row offset", pair.row_offset_px, 1.0, " px"),
    )
    rows = [CardRow("verdict", pair.verdict, bad=pair.verdict in ("suspect", "bad"))]
    for name, found, factor, unit in kinds:
        value = "not measured"
        if found is not None:
            value = text.with_sigma(factor * found.value, factor * found.sigma, 3, unit)
        rows.append(CardRow(name, value))
    if pair.depth_scale is not None:
        value = text.with_sigma(pair.depth_scale.value, pair.depth_scale.sigma, 4, "")
        rows.append(CardRow("depth scale", f"{value} (from {pair.depth_scale.source})"))
    return rows


def card_text(name: str, snapshot: Snapshot) -> str:
    """The card as plain text, to be copied."""
    title, rows = card_rows(snapshot)
    failed = len(snapshot.failures())
    lines = [f"{name}: {title.lower()}", f"frames: {len(snapshot.results)} computed, {failed} failed"]
    lines += [row.line for row in rows]
    why = pair_words(snapshot)
    return "\n".join(lines + ([f"stereo pair, why: {why}"] if why else []))


def card_html(snapshot: Snapshot) -> str:
    """The card for the page; every string in it is escaped."""
    title, rows = card_rows(snapshot)
    judged = snapshot.drive is not None and snapshot.drive.mount.height_m is not None
    return card(title, rows, (pair_words(snapshot), TWO_NUMBERS if judged else ""))


def sections_html(snapshot: Snapshot, truth: GroundTruth | None, notices: Sequence[str]) -> str:
    """Pair, LiDAR, and what the recording lacks or is good for: cards below the first one."""
    drive = snapshot.drive
    if drive is None:
        return card("This recording", (), (truth_words(truth), *notices[:8]))
    found = [card("Is the pair itself calibrated?", pair_rows(drive), (plain_units(drive.pair.why),))]
    lidar = lidar_rows(drive)
    if lidar:
        found.append(
            card("Do camera and LiDAR agree?", lidar, () if drive.lidar is None else (drive.lidar.unseen,))
        )
    lines = dict.fromkeys((*drive.notices, *notices))
    found.append(card("This recording", (), (truth_words(truth), *list(lines)[:8])))
    return "".join(found)
