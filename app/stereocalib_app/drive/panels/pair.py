"""The stereo pair itself: is it still calibrated, how that is known, and what mending it does to this drive."""

from __future__ import annotations

import html
from dataclasses import dataclass

import numpy as np

from stereocalib_app.drive.card import plain_units
from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.session import Session, Snapshot
from stereocalib_app.widgets import palette, text
from stereocalib_app.widgets.chart import Chart, ChartView, Curve
from stereocalib_core.back.analyse import analyse_openly
from stereocalib_core.back.odometry.packing import pack
from stereocalib_core.back.rig.pair_evidence import (
    NearAndFar,
    near_and_far,
    results_mended,
    rows_over_picture,
)
from stereocalib_core.back.rig.stereo_tracks import stereo_tracks
from stereocalib_core.back.rig.yaw_solution import solve_yaw
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.results import BEST, Drive, Measured, Pair

NEAR, FAR = palette.VARIANT["autocalibrated"], palette.VARIANT["no_roll"]
PLOT_PX = 120
REACH_PX = 1.0
"""Offsets shown on either side of the one found and of zero [px]."""
NOTHING = "Nothing to mend: what was found is small, or could not be measured."
FIELD_PX = 1.0
"""Row difference that is drawn in full colour [px]."""


@dataclass(frozen=True)
class Evidence:
    """Near and far points over the offset, None where the drive has no tracks or does not show it."""

    near_far: NearAndFar | None
    offset_px: float


def evidence(session: Session, drive: Drive, snapshot: Snapshot) -> Evidence | None:
    """Where the offset comes from; some tenths of a second for a thousand frames."""
    offset, camera, config = drive.pair.disparity_offset_px, session.camera, session.config
    if offset is None or not session.tracks:
        return None
    tracks = pack(camera, snapshot.results, config.odometry)
    block = stereo_tracks(camera, snapshot.results)
    held = _value(drive.pair.relative_roll_rad), _value(drive.pair.relative_pitch_rad)
    last = max((change.frame for change in drive.pair.changes), default=-1)
    active = np.asarray(tracks.active) & (np.arange(len(tracks)) > last)
    solution = solve_yaw(block, tracks.stereo_motion, active, held, config.pair)
    if solution is None:
        return None
    ends = sorted((0.0, offset.value))
    span = np.linspace(ends[0] - REACH_PX, ends[1] + REACH_PX, 61)
    return Evidence(near_and_far(block, solution, held, span, config.pair), offset.value)


def near_far_chart(found: Evidence | None) -> Chart:
    """The path by near and by far points over the offset assumed; the curves cross at the true one."""
    flat = np.array([0.0, 1.0])
    shown = None if found is None else found.near_far
    x, near, far = (
        (flat, flat * np.nan, flat * np.nan) if shown is None else (shown.offset_px, shown.near, shown.far)
    )
    at = 0.0 if found is None else found.offset_px
    low, high = (0.9, 1.1)
    if shown is not None:
        low, high = float(min(near.min(), far.min())) - 0.01, float(max(near.max(), far.max())) + 0.01
    curves = (
        Curve("near points", near, NEAR),
        Curve("far points", far, FAR),
        Curve(
            "offset found",
            np.where(np.abs(x - at) <= 0.5 * np.ptp(x) / max(len(x) - 1, 1), 1.0, np.nan),
            NEAR,
            dots=True,
        ),
    )
    return Chart(x, curves, (), (low, high), "path", "offset px", "offsets")


def rows_picture(camera: StereoCamera, pair: Pair) -> str:
    """The rows' difference over the picture as a small coloured grid: blue above, red below where they should be."""
    field = rows_over_picture(camera, pair)
    cells = "".join(
        f'<i style="background:{_shade(value)}" title="{value:+.2f} px"></i>' for value in field.ravel()
    )
    shape = f"aspect-ratio:{camera.width}/{camera.height}"
    style = f"display:grid;grid-template-columns:repeat({field.shape[1]},1fr);{shape}"
    largest = float(np.abs(field).max())
    label = html.escape(f"rows of right against left over the picture, up to {largest:.2f} px apart")
    inset = "margin:0.3em 0.7em"
    return f'<div style="font-size:0.85em;{inset}">{label}</div><div style="{style};{inset}">{cells}</div>'


def _shade(value: float) -> str:
    share = min(abs(value) / FIELD_PX, 1.0)
    red, blue = ((217, 84, 77), (77, 132, 217))
    ink = red if value > 0 else blue
    return f"rgba({ink[0]},{ink[1]},{ink[2]},{0.08 + 0.92 * share:.2f})"


def mended_drive(session: Session, snapshot: Snapshot) -> Drive | None:
    """The drive with its pair mended, from the same tracks and roads; None where there is nothing to mend."""
    drive = snapshot.drive
    correction = None if drive is None else drive.pair.correction
    if correction is None or correction.nothing or not session.tracks:
        return None
    results = results_mended(session.camera, snapshot.results, correction)
    return analyse_openly(results, session.camera, session.config, session.source.ground_truth)[0]


def before_and_after(before: Drive, after: Drive | None) -> str:
    """A table of what mending changes; without `after` the column is empty."""
    rows = [["", "as calibrated", "mended"]]
    for name, pick, digits, unit in (
        ("relative yaw", lambda d: _degrees(d.pair.relative_yaw_rad), 4, "°"),
        ("height", lambda d: float(np.nanmedian(d.frames.height_m)), 4, " m"),
        ("pitch", lambda d: float(np.rad2deg(np.nanmedian(d.frames.pitch_rad))), 3, "°"),
        ("path", lambda d: d.paths[BEST].errors.path_m if BEST in d.paths else None, 2, " m"),
        (
            "final error",
            lambda d: d.paths[BEST].errors.final_translation_percent if BEST in d.paths else None,
            2,
            " %",
        ),
    ):
        values = [text.number(pick(d), digits, unit) if d is not None else "" for d in (before, after)]
        rows.append([name, *values])
    return text.table(rows[0], rows[1:])


def _degrees(measured: Measured | None) -> float | None:
    return None if measured is None else float(np.rad2deg(measured.value))


def _value(measured: Measured | None) -> float:
    return 0.0 if measured is None else measured.value


def pair_words(pair: Pair) -> str:
    """The verdict and, one a line, what it rests on."""
    lines = [f"**{pair.verdict}**", *(f"- {text.escape(plain_units(part))}" for part in pair.why.split("; "))]
    return "\n".join([lines[0], "", *lines[1:]])


class PairPanel:
    """The tab about the pair itself."""

    def __init__(self, host: Host) -> None:
        gui, self._host = host.gui, host
        self._words = gui.add_markdown("The pair is judged when the whole drive is computed.")
        self._plot = ChartView(gui, near_far_chart(None), PLOT_PX)
        self._caption = gui.add_markdown("")
        self._rows = gui.add_html("<div></div>")
        self._mend = gui.add_checkbox("Mend the pair", False)
        self._table = gui.add_markdown("")
        self._shown: tuple[Session, Snapshot] | None = None
        self.mended: Drive | None = None
        """The drive with its pair mended, while the switch is on."""
        host.on_input(self._mend, self._switch)

    def _switch(self, on: bool) -> None:
        """Show what mending the pair changes, or only the drive as it is."""
        if self._shown is None:
            return
        session, snapshot = self._shown
        if snapshot.drive is not None:
            self.mended = mended_drive(session, snapshot) if on else None
            self._table.content = before_and_after(snapshot.drive, self.mended)
            if on and self.mended is None:
                self._table.content += f"\n\n{NOTHING}"

    def update(self, moment: Moment) -> None:
        """Show the pair once the whole drive is computed, and again when it is to be mended."""
        snapshot = moment.snapshot
        drive = snapshot.drive
        if not snapshot.done or drive is None:
            return
        if self._shown is not None and self._shown[1].drive is drive:
            return
        self._shown = moment.session, snapshot
        self._words.content = pair_words(drive.pair)
        found = evidence(moment.session, drive, snapshot)
        self._plot.show(near_far_chart(found))
        shown = None if found is None else found.near_far
        self._caption.content = (
            "This drive does not show the disparity offset."
            if shown is None
            else f"How far the car drove by points nearer than {shown.split_m:.0f} m and by those farther, over the "
            "disparity offset assumed. With a wrong one near and far want different motions: they cross at the true "
            "one."
        )
        self._rows.content = rows_picture(moment.session.camera, drive.pair)
        self._switch(self._mend.value)
