"""What a browser may send: only the value of a control, and only one that the page itself could have made.

viser takes over whatever a message says and passes it on to every browser; a hostile or broken client could stop
the page for a whole class. The check is put in front of viser's own handler.
"""

from __future__ import annotations

import logging
import math
from typing import Any

from viser import GuiApi

from stereocalib_app.server.viser_internals import check_values, held_value, limit_uploads

LOG = logging.getLogger(__name__)
LONGEST_TEXT = 4_000
UPLOAD_BYTES = 200_000_000
IDLE_UPLOAD_S = 60.0


def acceptable(control: Any, value: Any) -> bool:
    """Whether `value` is one that a person can set on a control (a viser handle)."""
    now = held_value(control)
    options = getattr(control, "options", None)
    if options is not None:
        return isinstance(value, str) and value in options
    if isinstance(now, bool):
        return isinstance(value, bool)
    if isinstance(now, int | float):
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            return False
        low, high = getattr(control, "min", None), getattr(control, "max", None)
        return (low is None or low <= value) and (high is None or value <= high)
    return isinstance(now, str) and isinstance(value, str) and len(value) <= LONGEST_TEXT


def guard(gui: GuiApi) -> None:
    """Refuse every other message that would change a control of `gui`."""

    def refused(client_id: int) -> None:
        LOG.info("browser %d sent a value that no person can set: refused", client_id)

    def too_much(client_id: int, name: str) -> None:
        LOG.info("browser %d sends more than is taken (%s): refused", client_id, name[:80])

    check_values(gui, acceptable, refused)
    limit_uploads(gui, UPLOAD_BYTES, IDLE_UPLOAD_S, too_much)
