"""One page: shared by all browsers that follow the lead, or owned by one browser that explores on its own.

`api` is viser's server or one of its clients; both have `gui`, `scene` and `atomic()`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from app.frame_views import FrameView
from app.moment import Moment
from app.panels.header import HeaderPanel
from app.panels.inspect import InspectPanel
from app.panels.timeline import TimelinePanel
from app.panels.views import ViewsPanel
from app.playback import ClockState, Playback
from app.scene_part import ScenePart
from app.session import Session
from app.settings import Settings
from stereocalib_core.errors import StereoCalibError

if TYPE_CHECKING:
    from app.hub import Hub

LOG = logging.getLogger(__name__)


class Page:
    """Owns its clock, its settings, its panels and its part of the scene."""

    def __init__(self, hub: Hub, api: Any, session: Session, name: str, owner: int | None = None) -> None:
        self.hub, self.api, self.session, self.name, self.owner = hub, api, session, name, owner
        self.gui = api.gui
        self.settings = Settings()
        self._roots: list[Any] = []
        self._commands: list[Any] = []
        self._last: tuple[int, int, Settings, ClockState] | None = None
        self._closed = False
        self.playback = Playback(
            session.source.timestamps_s,
            lambda: len(session.snapshot.results),
            lambda: session.snapshot.failures(),
            self._tick,
        )
        with api.atomic():
            self.parts: list[Any] = [
                ViewsPanel(self),
                HeaderPanel(self),
                TimelinePanel(self),
                ScenePart(self),
                InspectPanel(self),
            ]

    def start(self) -> None:
        """Start the clock."""
        self.playback.start()

    def close(self) -> None:
        """Stop the clock and take the page's elements away."""
        self._closed = True
        self.playback.close()
        with self.api.atomic():
            for command in self._commands:
                command.remove()
            for part in self.parts:
                if isinstance(part, ScenePart):
                    part.close()
            for handle in self._roots:
                handle.remove()

    def add_panel(self) -> Any:
        """A movable panel that belongs to this page."""
        panel = self.gui.add_panel()
        self._roots.append(panel)
        return panel

    def add_root(self, handle: Any) -> Any:
        """Remember an element of the main panel, to hide or remove it with the page."""
        self._roots.append(handle)
        return handle

    @property
    def root_ids(self) -> list[str]:
        """Identifiers of everything to hide in a browser that leaves this page."""
        return [handle._impl.uuid for handle in self._roots]

    def add_command(
        self, label: str, run: Callable[[], Any], hotkey: Any = None, modifier: Any = None
    ) -> None:
        """A command of the palette, with its hotkey."""
        command = self.gui.add_command(label, hotkey=hotkey, modifier=modifier)
        self._commands.append(command)

        @command.on_trigger
        def _(event: Any) -> None:
            self._guarded(event, lambda _value: run(), None)

    def on_input(self, handle: Any, action: Callable[[Any], Any]) -> None:
        """Run `action(value)` when a person (not the program) changes an input."""

        @handle.on_update
        def _(event: Any) -> None:
            if event.client_id is not None:
                self._guarded(event, action, handle.value)

    def on_click(self, handle: Any, action: Callable[[Any], Any]) -> None:
        """Run `action(value)` when a person presses a button or one of a group."""

        @handle.on_click
        def _(event: Any) -> None:
            if event.client_id is not None:
                self._guarded(event, action, getattr(handle, "value", None))

    def _guarded(self, event: Any, action: Callable[[Any], Any], value: Any) -> None:
        """Actions of people: refused for followers while the lead is held, errors told kindly."""
        client = event.client
        if self._closed or not self.hub.may_steer(self, event.client_id):
            self._last = None
            self.playback.poke()
            return
        try:
            action(value)
        except StereoCalibError as error:
            LOG.info("%s", error)
            if client is not None:
                client.add_notification("That did not work", str(error), color="red", auto_close_seconds=12.0)

    def change(self, **changes: Any) -> None:
        """Change settings and show the result."""
        self.settings = replace(self.settings, **changes)
        self.playback.poke()

    def _view(self, frame: int) -> FrameView | None:
        if len(self.session.source) == 0:
            return None
        live = self.hub.live_extrinsics(self, frame)
        return self.session.views.get(frame, self.settings.layout, live)

    def _tick(self, clock: ClockState) -> None:
        """Called by the clock's worker only."""
        if self._closed:
            return
        snapshot, settings = self.session.snapshot, self.settings
        last = self._last
        key = (clock.frame, snapshot.version, settings, clock)
        if key == last:
            return
        computed_now = last is not None and clock.frame >= 0 and last[1] != snapshot.version
        frame_changed = last is None or last[0] != clock.frame or last[3].playing != clock.playing
        settings_changed = last is None or last[2] != settings
        drive_changed = last is None or computed_now
        view = self._view(clock.frame) if frame_changed or settings_changed else None
        moment = Moment(
            self.session, snapshot, clock, settings, view, frame_changed, drive_changed, settings_changed
        )
        with self.api.atomic():
            for part in self.parts:
                part.update(moment)
        self.api.flush()
        self._last = key

    @property
    def shown_frame(self) -> int:
        """The frame that was shown last, -1 before the first."""
        return -1 if self._last is None else self._last[0]

    def small_picture(self, frame: int) -> np.ndarray | None:
        """The left image, small, for the frustum."""
        import cv2

        left = self.session.views.stages(frame).frame.left
        if left is None:
            return None
        height = max(1, round(left.shape[0] * 320 / left.shape[1]))
        return cv2.cvtColor(cv2.resize(left, (320, height), interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2RGB)
