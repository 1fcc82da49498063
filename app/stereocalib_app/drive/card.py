"""The answer first: how the camera is mounted, as rows that become a card on the page or lines of text."""

from __future__ import annotations

import re

import numpy as np

from stereocalib_app.drive.session import Snapshot
from stereocalib_app.widgets import text
from stereocalib_app.widgets.card import CardRow, card
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
            value = f"not known: {drive.yaw_reason}"
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
    return card(title, rows, (pair_words(snapshot),))
