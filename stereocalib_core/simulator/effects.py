"""What weather, light and dirt do to a view: pure functions from a perfect grey picture to a spoilt one."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.scene import DIRTY_SHARE, GLARE, HEADLIGHTS, NIGHT_LIGHT, NIGHT_NOISE
from stereocalib_core.simulator.faults import Fault, any_active
from stereocalib_core.simulator.textures import tileable_noise

Grey = NDArray[np.float32]


def spoil(grey: Grey, faults: tuple[Fault, ...], frame: int, side: int, seed: int) -> Grey:
    """The view (H, W) of camera `side` (0 left, 1 right) with every fault of the light path in force."""
    if any_active(faults, "night", frame):
        grey = night(grey)
    if any_active(faults, "rain", frame):
        grey = rain(grey, seed, frame, side)
    if any_active(faults, "glare", frame):
        grey = glare(grey)
    if side == 0 and any_active(faults, "dirt", frame):
        grey = dirt(grey, seed)
    return grey


def noise_factor(faults: tuple[Fault, ...], frame: int) -> float:
    """What the sensor's noise is multiplied by."""
    return NIGHT_NOISE if any_active(faults, "night", frame) else 1.0


def night(grey: Grey) -> Grey:
    """Little light but the car's own, in a flat cone ahead."""
    height, width = grey.shape
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    cone = np.exp(-(((x / width - 0.5) / 0.28) ** 2) - ((y / height - 0.78) / 0.24) ** 2)
    return (grey * (NIGHT_LIGHT + HEADLIGHTS * cone) + 3.0).astype(np.float32)


def rain(grey: Grey, seed: int, frame: int, side: int) -> Grey:
    """Dim light, streaks that differ from frame to frame and between the cameras, and drops on the lens."""
    height, width = grey.shape
    rng = np.random.default_rng([seed, 51, frame, side])
    wet = np.asarray(cv2.GaussianBlur(grey, (0, 0), 0.8) * 0.72 + 28, dtype=np.float32)
    streaks = np.zeros((height, width), np.float32)
    for _ in range(int(width * height / 1500)):
        x, y = rng.uniform(0, width), rng.uniform(-20, height)
        long, lean = rng.uniform(8, 38), rng.normal(0.12, 0.05)
        end = (int(16 * (x + lean * long)), int(16 * (y + long)))
        cv2.line(streaks, (int(16 * x), int(16 * y)), end, float(rng.uniform(18, 60)), 1, cv2.LINE_AA, 4)
    wet = np.asarray(wet + cv2.GaussianBlur(streaks, (0, 0), 0.6), dtype=np.float32)
    rng = np.random.default_rng([seed, 52, frame // 15, side])
    drops = np.zeros((height, width), np.float32)
    for _ in range(28):
        center = (int(rng.uniform(0, width)), int(rng.uniform(0, height)))
        size = (int(rng.uniform(5, 17)), int(rng.uniform(5, 20)))
        cv2.ellipse(drops, center, size, 0, 0, 360, 1.0, -1)
    through = cv2.GaussianBlur(drops, (0, 0), 2.0)
    return np.asarray(wet + through * (cv2.GaussianBlur(wet, (0, 0), 9.0) * 1.1 - wet), dtype=np.float32)


def glare(grey: Grey) -> Grey:
    """The sun ahead: a disc that saturates, its halo, a veil over everything, and ghosts of the lens."""
    height, width = grey.shape
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    away = np.hypot(x - 0.56 * width, 1.25 * (y - 0.22 * height)) / width
    light = GLARE * np.exp(-((away / 0.10) ** 2)) + 0.55 * GLARE * np.exp(-away / 0.16) + 25
    for k, size in ((0.3, 0.03), (-0.25, 0.05), (-0.6, 0.08)):
        ghost = np.hypot(x - width * (0.5 + 0.06 * k), y - height * (0.5 - 0.28 * k)) / width < size
        light = light + 18 * ghost
    return (0.8 * grey + light).astype(np.float32)


@lru_cache(maxsize=4)
def _dirt_mask(height: int, width: int, seed: int) -> Grey:
    """(H, W) how opaque the lens is, 0...1."""
    rng = np.random.default_rng([seed, 53])
    small = tileable_noise((256, 512), [(24, 0.25), (60, 0.7), (160, 1.0)], rng)
    noise = np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC))
    edge = float(np.quantile(noise, 1 - DIRTY_SHARE))
    return np.asarray(np.clip((noise - edge) / 0.35 + 0.5, 0, 1), dtype=np.float32)


def dirt(grey: Grey, seed: int) -> Grey:
    """Mud on the lens: out of focus, it dims and smears what is behind."""
    mask = _dirt_mask(*grey.shape, seed)
    smeared = cv2.GaussianBlur(grey, (0, 0), 25.0) * np.float32(0.25) + np.float32(8)
    return np.asarray(grey * (1 - mask) + smeared * mask, dtype=np.float32)
