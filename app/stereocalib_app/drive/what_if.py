"""What if the calibration were another: the corrections of a page, with the setting before the last change kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from stereocalib_app.drive.settings import Corrections


class WhatIf:
    """Changes the corrections of a page. now: reads them, apply: sets them."""

    def __init__(self, now: Callable[[], Corrections], apply: Callable[[Corrections], None]) -> None:
        self._now, self._apply = now, apply
        self._previous = Corrections()

    def set(self, **changes: Any) -> None:
        """Change some corrections; the first of a series of changes to the same field is kept for A / B."""
        now = self._now()
        new = replace(now, **changes)
        fields = {k for k in vars(now) if getattr(now, k) != getattr(new, k)}
        last = {k for k in vars(now) if getattr(now, k) != getattr(self._previous, k)}
        if fields != last:
            self._previous = now
        self._apply(new)

    def toggle(self, axis: str) -> None:
        """Switch one correction between 0 and 100 %."""
        now = getattr(self._now(), f"{axis}_strength")
        self.set(**{f"{axis}_strength": 0.0 if now > 0 else 1.0})

    def swap(self) -> None:
        """A / B against the previous setting."""
        now = self._now()
        self._apply(self._previous)
        self._previous = now

    def reset(self) -> None:
        """Back to the plain result."""
        self._previous = self._now()
        self._apply(Corrections())
