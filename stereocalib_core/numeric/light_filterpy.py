"""filterpy's unscented filter, imported without scipy.stats.

filterpy imports that for the likelihood of a measurement alone, which nobody here asks for: half a second of every
start. Whoever does ask, or imports `filterpy.stats` later, gets the real one.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

__all__ = ["MerweScaledSigmaPoints", "UnscentedKalmanFilter"]
_NAME = "filterpy.stats"


def _logpdf(*arguments: Any, **named: Any) -> Any:
    from filterpy.stats import logpdf

    return logpdf(*arguments, **named)


_light: ModuleType | None = None
if "filterpy" not in sys.modules:
    _light = sys.modules[_NAME] = ModuleType(_NAME)
    _light.logpdf = _logpdf  # type: ignore[attr-defined]
try:
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
finally:
    if _light is not None:
        del sys.modules[_NAME]
        vars(sys.modules.get("filterpy", _light)).pop("stats", None)
