"""What a page is set to, as KEY=VALUE words of the command line and back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final

from stereocalib_app.drive.settings import (
    ERROR_LIMIT_DEG,
    ERROR_LIMIT_M,
    EXTRINSICS,
    LAYOUTS,
    MODELS,
    PRESETS,
    Corrections,
    Settings,
)
from stereocalib_app.widgets.palette import VARIANT
from stereocalib_app.words.lessons import BROKEN_STAGES, LESSONS
from stereocalib_core.errors import ConfigError


def _one_of(names: Sequence[str]) -> Callable[[str], str]:
    def parsed(text: str) -> str:
        if text not in names:
            raise ValueError(f"one of {', '.join(filter(None, names))}")
        return text

    return parsed


def _between(low: float, high: float, kind: type = float) -> Callable[[str], Any]:
    def parsed(text: str) -> Any:
        value = kind(text)
        if not low <= value <= high:
            raise ValueError(f"{low:g} to {high:g}")
        return value

    return parsed


def _switch(text: str) -> bool:
    return {"on": True, "off": False}[text]


_STRENGTH, _ANGLE = _between(0.0, 1.0), _between(-ERROR_LIMIT_DEG, ERROR_LIMIT_DEG)
_CORRECTIONS: Final[dict[str, Callable[[str], Any]]] = {
    **{f"{axis}_strength": _STRENGTH for axis in ("yaw", "pitch", "roll", "height")},
    **{f"{axis}_error_deg": _ANGLE for axis in ("yaw", "pitch", "roll")},
    "height_error_m": _between(-ERROR_LIMIT_M, ERROR_LIMIT_M),
    "source": _one_of(EXTRINSICS),
    "model": _one_of(MODELS),
}
_SETTINGS: Final[dict[str, Callable[[str], Any]]] = {
    "preset": _one_of(PRESETS),
    "layout": _one_of(LAYOUTS),
    **dict.fromkeys(("follow", "cloud", "markers", "color_by_error"), _switch),
    "teach_step": _between(0, len(LESSONS) - 1, int),
    "broken_stage": _one_of(("", *BROKEN_STAGES)),
}
HIDE: Final = "hide"
KEYS: Final = (*_SETTINGS, *_CORRECTIONS, HIDE)


def _word(name: str, value: Any) -> str:
    shown = (
        ("on" if value else "off")
        if isinstance(value, bool)
        else f"{value:g}"
        if isinstance(value, float)
        else value
    )
    return f"{name}={shown}"


def to_words(settings: Settings) -> list[str]:
    """What differs from a page as it opens."""
    plain, corrections = Settings(), settings.corrections
    words = [
        _word(name, getattr(settings, name))
        for name in _SETTINGS
        if getattr(settings, name) != getattr(plain, name)
    ]
    words += [
        _word(name, getattr(corrections, name))
        for name in _CORRECTIONS
        if getattr(corrections, name) != getattr(plain.corrections, name)
    ]
    return words + [f"{HIDE}={name}" for name, shown in settings.paths.items() if not shown]


def from_words(words: Sequence[str]) -> Settings:
    """The page that such words describe; raises ConfigError."""
    settings, corrections, paths = Settings(), Corrections(), dict[str, bool]()
    for word in words:
        name, _, text = word.partition("=")
        try:
            if name == HIDE:
                paths[_one_of(tuple(VARIANT))(text)] = False
            elif name in _CORRECTIONS:
                corrections = replace(corrections, **{name: _CORRECTIONS[name](text)})
            elif name in _SETTINGS:
                settings = replace(settings, **{name: _SETTINGS[name](text)})
            else:
                raise ConfigError("bad usage", f"--set {word[:60]}", f"one of {', '.join(KEYS)}")
        except KeyError:
            raise ConfigError("bad usage", f"--set {word[:60]}", "on or off") from None
        except ValueError as error:
            raise ConfigError("bad usage", f"--set {word[:60]}", str(error)) from error
    return replace(settings, corrections=corrections, paths=MappingProxyType(paths))
