"""One page: shared by all browsers that follow the lead, or owned by one browser that explores on its own.

`api` is viser's server or one of its clients; both have `gui`, `scene`, `atomic()` and `flush()`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, Protocol

from stereocalib_app.drive.debut import Debut
from stereocalib_app.drive.frame_views import Lesson, Look
from stereocalib_app.drive.lesson_marks import path_around
from stereocalib_app.drive.moment import Moment, filtered_at
from stereocalib_app.drive.panel import Doors
from stereocalib_app.drive.panels.header import HeaderPanel
from stereocalib_app.drive.panels.plots import PlotsPanel
from stereocalib_app.drive.panels.views import ViewsPanel
from stereocalib_app.drive.path_state import PathBook, PathState
from stereocalib_app.drive.scene_part import ScenePart
from stereocalib_app.drive.session import Session
from stereocalib_app.drive.settings import Settings
from stereocalib_app.drive.viewpoint import FOLLOWING, place_camera
from stereocalib_app.drive.what_if import WhatIf
from stereocalib_app.server.clock import ClockState, Playback
from stereocalib_app.server.library import Library
from stereocalib_app.widgets.page_base import PageBase
from stereocalib_app.words.lessons import LESSONS
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import Drive

TICKS_AHEAD = 4
CHOICES = 8
"""So many frames back a picture is taken that is ready rather than one that must be made first."""


class Keeper(Protocol):
    """Who keeps the pages: knows the browsers, and opens other drives."""

    @property
    def library(self) -> Library:
        """What may be opened."""

    def may_steer(self, page: Page, client_id: int | None) -> bool:
        """Whether a browser may change a page."""

    def viewers(self, page: Page) -> list[Any]:
        """The browsers that show a page."""

    def open(self, page: Page, text: str) -> None:
        """Open what was typed on a page."""

    def open_upload(self, page: Page, upload: Any) -> None:
        """Open a zip that was uploaded on a page."""

    def reopen(self, page: Page, spec: str, frame: int, same_before: int) -> None:
        """Open a variation of the drive of a page."""

    def compare(self, page: Page, text: str) -> None:
        """Lay an earlier run beside the drive of a page."""

    def shown(self, page: Page, moment: Moment, version: int) -> None:
        """A page shows a moment."""


class Page(PageBase):
    """Owns its clock, its settings, its panels and its part of the scene."""

    def __init__(
        self,
        keeper: Keeper,
        api: Any,
        session: Session,
        name: str,
        owner: int | None = None,
        settings: Settings | None = None,
        debut: Debut | None = None,
    ) -> None:
        super().__init__(api.gui)
        self._keeper, self.api, self.session, self.name, self.owner = keeper, api, session, name, owner
        self.shared = owner is None
        self.settings = settings or Settings()
        self.debut = debut or Debut(over=True)
        self.what_if = WhatIf(lambda: self.settings.corrections, lambda new: self.change(corrections=new))
        self.doors = Doors(
            keeper.library.root,
            keeper.library.tolerance,
            partial(keeper.open, self),
            partial(keeper.open_upload, self),
            partial(keeper.reopen, self),
            partial(keeper.compare, self),
            keeper.library.resolve,
            keeper.library.name_of,
        )
        self.compared: Drive | None = None
        self._roots: list[Any] = []
        self._last: tuple[int, int, Settings, ClockState, int] | None = None
        self._revision = 0
        self._paths = PathState()
        self._signals: tuple[Any, ...] = (None, None, None)
        self._version = 0
        self._closed = False
        self._book = PathBook(session.source.ground_truth)
        self.playback = Playback(
            session.source.timestamps_s,
            lambda: len(session.snapshot.results),
            lambda: session.snapshot.failures(),
            self._tick,
            self._choose,
        )
        with api.atomic():
            self.views = ViewsPanel(self)
            self.header = HeaderPanel(self)
            self.plots = PlotsPanel(self)
            self.scene = ScenePart(self, api, name, self.debut)
        self.parts: dict[str, Any] = {**self.header.parts, **self.plots.parts}

    def start(self) -> None:
        """Start the clock."""
        self.playback.start()

    def close(self) -> None:
        """Stop the clock and take the page's elements away."""
        self._closed = True
        self.playback.close()
        with self.api.atomic():
            self.scene.close()
            for handle in self._roots:
                handle.remove()

    def detach_for_good(self) -> None:
        """The browser has gone: forget its elements without speaking to it."""
        self._closed = True
        self._roots.clear()

    def add_panel(self) -> Any:
        """A movable panel that belongs to this page."""
        return self.add_root(self.gui.add_panel())

    def add_root(self, handle: Any) -> Any:
        """Remember an outermost element, to hide or remove it with the page."""
        self._roots.append(handle)
        return handle

    @property
    def roots(self) -> list[Any]:
        """The outermost elements, to hide in a browser that leaves this page."""
        return list(self._roots)

    @property
    def closed(self) -> bool:
        """Whether another page has taken its place, or none will."""
        return self._closed

    def may_act(self, event: Any) -> bool:
        """Followers do not steer while somebody holds the lead."""
        if self._closed:
            return False
        if self._keeper.may_steer(self, event.client_id):
            return True
        self.tell(event.client, "The lecturer leads", "Choose “Explore on my own” below to move freely.")
        self.refresh()
        return False

    def change(self, **changes: Any) -> None:
        """Change settings and show the result."""
        with self._acting:
            self.settings = replace(self.settings, **changes)
        self.playback.poke()

    def choose(self, preset: str) -> None:
        """Change the preset; each starts with its own view."""
        layout = LESSONS[self.settings.teach_step].layout if preset == "Teach" else "left image"
        self.change(preset=preset, layout=layout)

    def restore(self, settings: Settings, frame: int) -> None:
        """Show what a link says."""
        self.change(**{name: getattr(settings, name) for name in vars(settings)})
        self.playback.play(False)
        self.playback.seek(frame)

    def set_follow(self, follow: bool) -> None:
        """Follow the car, or stand back so far that the whole drive is in sight."""
        self.change(follow=follow)
        view = FOLLOWING if follow else self.scene.overview()
        for client in self._keeper.viewers(self):
            place_camera(client, view)

    def seek_failure(self, direction: int) -> None:
        """Go to the next (+1) or previous (-1) failed frame, and say so where that leads round the end of the
        drive, or where there is none."""
        before = self.playback.state.frame
        found = self.playback.seek_failure(direction)
        if found is None:
            snapshot = self.session.snapshot
            computed = "" if snapshot.done else f" of the {100 * snapshot.progress:.0f} % computed so far"
            self._notify("No failed frame", f"Every frame{computed} is ok.")
        elif found == before:
            self._notify("The only failed frame", f"No other frame than {found} has failed.")
        elif (found > before) != (direction > 0):
            first_or_last = "first" if direction > 0 else "last"
            self._notify("Round the end", f"Frame {found} is the {first_or_last} that failed.")

    def _notify(self, title: str, words: str) -> None:
        """Tell every browser that shows this page."""
        for client in self._keeper.viewers(self):
            self.tell(client, title, words, 5.0)

    def set_compared(self, run: Drive | None) -> None:
        """Lay another run beside this one."""
        self.compared = run
        self.refresh()

    def refresh(self) -> None:
        """Show everything again, also what the page believes to be on show already."""
        self._revision += 1
        self.playback.poke()

    @property
    def shown_frame(self) -> int:
        """The frame that was shown last, -1 before the first."""
        return -1 if self._last is None else self._last[0]

    def _live_road(self, frame: int, settings: Settings) -> Extrinsics | None:
        """The road as the page's corrections see it, None while they are untouched."""
        paths = self.session.snapshot.paths
        if paths is None or not settings.corrections.touched:
            return None
        return paths.road_at(frame, settings.corrections)

    def _look(self, frame: int, settings: Settings) -> Look:
        """How a frame is looked at under the page's settings."""
        filtered = filtered_at(self.session.snapshot, frame)
        road = None if filtered is None else filtered[0]
        result = self.session.snapshot.result(frame)
        lesson = None
        if settings.preset == "Teach":
            drive = self.session.snapshot.drive
            yaw = None if drive is None else drive.mount.yaw_rad
            known = None if filtered is None else (filtered[0], filtered[1])
            title, turn = LESSONS[settings.teach_step].title, 0.0 if yaw is None else yaw.value
            poses = self._paths.poses.get("live", self._paths.poses.get("autocalibrated"))
            path = path_around(poses, frame) if title == "Odometry" and poses is not None else None
            lesson = Lesson(title, result, known, turn, path)
        return Look(
            settings.layout,
            self._live_road(frame, settings),
            None if result is None or result.ok else road,
            lesson,
        )

    def _tick(self, clock: ClockState) -> None:
        """Called by the clock's worker only."""
        snapshot, settings, last = self.session.snapshot, self.settings, self._last
        key = (clock.frame, snapshot.version, settings, clock, self._revision)
        if self._closed:
            # Its elements are gone: a clock that went on would speak to nobody, for ever.
            self.playback.close()
            return
        if key == last and not self.scene.due:
            return
        frame_changed = last is None or last[0] != clock.frame or last[3].playing != clock.playing
        settings_changed = last is None or last[2] != settings or last[4] != self._revision
        drive_changed = last is None or last[1] != snapshot.version
        if self.session.tracks and snapshot.paths is not None:
            paths = self._book.state(snapshot.paths, settings.corrections)
        else:
            paths = self._book.saved(None if snapshot.drive is None else snapshot.drive.poses)
        self._paths = paths
        moment = Moment(
            session=self.session,
            snapshot=snapshot,
            clock=clock,
            settings=settings,
            view=None,
            paths=paths,
            compared=self.compared,
            frame_changed=frame_changed,
            drive_changed=drive_changed,
            settings_changed=settings_changed,
        )
        if settings_changed and not frame_changed:
            # The path follows a slider at once; the pictures come right after it.
            with self.api.atomic():
                if not self._closed:
                    self.scene.show_paths(moment)
            self.api.flush()
        if last is None:
            # The first picture may take seconds (a world to be built): the page can be used before.
            self._show(moment)
        if frame_changed or settings_changed:
            views = self.session.views_with(settings.broken_stage)
            view = views.get(clock.frame, self._look(clock.frame, settings), clock.playing)
            moment = replace(moment, view=view)
        self._show(moment)
        self._last = key
        self._make_ahead(settings)

    def _show(self, moment: Moment) -> None:
        """Everything of one moment in one window of messages."""
        with self.api.atomic():
            if self._closed:
                # Closed while a picture was made: the elements are gone.
                return
            for part in (self.views, self.header, self.plots, self.scene):
                part.update(moment)
        self.api.flush()
        signals = (moment.snapshot.version, moment.paths, moment.compared)
        if any(a is not b for a, b in zip(signals, self._signals, strict=True)):
            self._signals, self._version = signals, self._version + 1
        self._keeper.shown(self, moment, self._version)

    def _choose(self, after: int, due: int) -> int:
        """The newest frame up to the one that is due whose picture is made already, else the due one."""
        settings = self.settings
        views = self.session.views_with(settings.broken_stage)
        for frame in range(due, max(after, due - CHOICES), -1):
            if views.has(frame, self._look(frame, settings), moving=True):
                return frame
        return due

    def _make_ahead(self, settings: Settings) -> None:
        """While playing, have the next pictures made while this one travels."""
        frames = self.playback.upcoming(TICKS_AHEAD)
        if frames and not self._closed:
            views = self.session.views_with(settings.broken_stage)
            views.make_ahead([(f, self._look(f, settings)) for f in frames])
