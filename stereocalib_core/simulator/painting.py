"""Procedural grey textures of a town, painted from a seed."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.numeric.arrays import Grey
from stereocalib_core.simulator.textures import tileable_noise

FACADES = 8
CAR_TEXEL_M = 0.01


def to_grey(values: NDArray[np.floating]) -> Grey:
    """Rounded and cut to 0...255."""
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def grain(rng: np.random.Generator) -> Grey:
    """Asphalt at close range, mean 128: stones, tar between them, and soft mottling."""
    noise = tileable_noise((1024, 1024), [(2.5, 17), (5, 15), (11, 8), (30, 5), (110, 5), (300, 4)], rng)
    return to_grey(128 + noise - np.minimum(noise + 25, 0) * 0.6)


def sky(rng: np.random.Generator) -> Grey:
    """The whole horizon, 4096 texels around: bright sky over distant trees and roofs at infinity."""
    width, height = 4096, 512
    turn = width / (2 * np.pi)
    rise = 0.55 - (np.arange(height) + 0.5)[:, None] / turn
    image = np.full((height, width), 0.0)
    clouds = tileable_noise((height, width), [(60, 6), (180, 8), (500, 10)], rng)
    azimuth = 2 * np.pi * np.arange(width) / width
    image[:] = 262 - 110 * np.clip(rise / 0.5, 0, 1) + 22 * np.cos(azimuth - 1.0)[None, :] + clouds
    ridge = tileable_noise((1, width), [(16, 0.0035), (60, 0.005), (300, 0.008)], rng)[0] + 0.030
    far = tileable_noise((height, width), [(3, 14), (8, 12), (40, 10)], rng)
    ground = rise < ridge[None, :]
    image[ground] = (82 + far)[ground]
    return to_grey(image)


def facade(rng: np.random.Generator) -> Grey:
    """A house front, 10.24 m square, the street at its lower edge: three storeys of windows, a door."""
    n = 512
    wall = rng.choice([80, 115, 145, 175, 205])
    image = wall + tileable_noise((n, n), [(3, 5), (10, 4), (60, 7), (220, 9)], rng)
    if rng.random() < 0.3:
        rows = (np.arange(n) % 4 == 0)[:, None] * -22.0
        bond = ((np.arange(n)[None, :] + 6 * ((np.arange(n)[:, None] // 4) % 2)) % 12 == 0) * -22.0
        image = image + rows + bond
    image[-22:] = 0.62 * image[-22:] + rng.normal(0, 6, (22, n))
    bays = int(rng.integers(3, 5))
    pitch = n / bays
    wide, shutters = int(rng.uniform(42, 62)), rng.random() < 0.5
    door = int(rng.integers(0, bays))
    for floor, (low, tall) in enumerate(((48, 66), (188, 68), (328, 66))):
        if floor and rng.random() < 0.4:
            cv2.line(image, (0, n - low + 26), (n, n - low + 26), float(wall * 0.78), 3)
        for bay in range(bays):
            x = int((bay + 0.5) * pitch - wide / 2)
            y = n - low - tall
            if floor == 0 and bay == door:
                cv2.rectangle(image, (x + 4, n - 112), (x + wide - 4, n - 4), float(rng.uniform(35, 80)), -1)
                cv2.rectangle(
                    image, (x + 10, n - 106), (x + wide - 10, n - 62), float(rng.uniform(20, 50)), -1
                )
                cv2.rectangle(image, (x, n - 8), (x + wide, n), float(wall * 0.7), -1)
                continue
            _window(image, x, y, wide, tall, shutters, wall, rng)
    return to_grey(image)


def _window(
    image: NDArray[np.floating],
    x: int,
    y: int,
    wide: int,
    tall: int,
    shutters: bool,
    wall: float,
    rng: np.random.Generator,
) -> None:
    cv2.rectangle(image, (x - 5, y - 5), (x + wide + 5, y + tall + 5), float(min(wall * 1.22, 250)), -1)
    dark = rng.uniform(18, 60)
    shine = np.linspace(rng.uniform(0, 60), 0, tall)[:, None]
    glass = dark + shine + rng.normal(0, 3, (tall, wide))
    if rng.random() < 0.6:
        cut = int(rng.uniform(0.2, 0.7) * tall)
        glass[:cut] = rng.uniform(110, 190) + 10 * np.sin(np.arange(wide) / rng.uniform(1, 3))[None, :]
    image[y : y + tall, x : x + wide] = glass
    frame = float(rng.choice([60, 210, 225]))
    cv2.line(image, (x + wide // 2, y), (x + wide // 2, y + tall), frame, 3)
    cv2.line(image, (x, y + tall // 3), (x + wide, y + tall // 3), frame, 2)
    cv2.rectangle(image, (x, y), (x + wide, y + tall), frame, 3)
    cv2.rectangle(image, (x - 8, y + tall + 4), (x + wide + 8, y + tall + 8), float(wall * 0.62), -1)
    if shutters:
        tone = float(rng.uniform(45, 100))
        for left in (x - 24, x + wide + 6):
            cv2.rectangle(image, (left, y - 3), (left + 18, y + tall + 3), tone, -1)
            for line in range(y, y + tall, 5):
                cv2.line(image, (left, line), (left + 18, line), tone * 0.7, 1)


def roof(rng: np.random.Generator) -> Grey:
    """Tiles, 5.12 m square."""
    n = 256
    y, x = np.mgrid[0:n, 0:n]
    image = 92 + 20 * np.sin(2 * np.pi * x / 16) - 34.0 * (y % 16 < 3)
    return to_grey(image + tileable_noise((n, n), [(8, 9), (40, 8), (120, 9)], rng))


def bark(rng: np.random.Generator) -> Grey:
    """Bark, stretched upward."""
    noise = tileable_noise((128, 128), [(4, 18), (12, 18), (40, 12)], rng)
    return to_grey(95 + 1.1 * cv2.resize(noise[:32], (128, 128), interpolation=cv2.INTER_LINEAR))


def foliage(rng: np.random.Generator) -> tuple[Grey, Grey]:
    """A branch full of leaves, and where it is not a hole (255)."""
    n = 512
    light = np.full((n, n), 36, np.float64)
    mask = np.zeros((n, n), np.uint8)
    twigs = rng.uniform(0, 2 * np.pi, 9)
    for angle in twigs:
        tip = (int(n / 2 + 0.42 * n * np.cos(angle)), int(n / 2 + 0.42 * n * np.sin(angle)))
        cv2.line(light, (n // 2, n // 2), tip, 52.0, 3)
        cv2.line(mask, (n // 2, n // 2), tip, 255.0, 3)
    for _ in range(1500):
        radius = 0.46 * n * np.sqrt(rng.random())
        angle = rng.choice(twigs) + rng.normal(0, 0.33)
        center = (int(n / 2 + radius * np.cos(angle)), int(n / 2 + radius * np.sin(angle)))
        axes = (int(rng.uniform(6, 13)), int(rng.uniform(3, 6)))
        turn = rng.uniform(0, 360)
        tone = float(np.clip(rng.normal(126, 60), 16, 255))
        cv2.ellipse(light, center, axes, turn, 0, 360, tone, -1)
        cv2.ellipse(mask, center, axes, turn, 0, 360, 255, -1)
    return to_grey(light + rng.normal(0, 4, (n, n))), mask


def hedge(rng: np.random.Generator) -> Grey:
    """Leaves without holes, for hedges and bushes."""
    n = 256
    light = np.full((n, n), 34, np.float64)
    spots, tones = rng.integers(0, n, (5200, 2)), np.clip(rng.normal(88, 38, 5200), 12, 250)
    for (x, y), tone in zip(spots.tolist(), tones.tolist(), strict=True):
        # what sticks out on one side comes in on the other
        for dx in (0, n) if x < 6 else (0, -n) if x > n - 6 else (0,):
            for dy in (0, n) if y < 6 else (0, -n) if y > n - 6 else (0,):
                cv2.ellipse(light, (x + dx, y + dy), (4, 2), x * 7.0, 0, 360, tone, -1)
    # shoots stand out from the shade between them
    return to_grey(light + tileable_noise((n, n), [(20, 9), (60, 12)], np.random.default_rng(n)))


def grass(rng: np.random.Generator) -> Grey:
    """Lawn and bare earth, 512 texels of 2 cm."""
    noise = tileable_noise((512, 512), [(3, 17), (6, 14), (16, 10), (60, 10), (200, 12)], rng)
    return to_grey(96 + noise)


def plaster(rng: np.random.Generator) -> Grey:
    """Garden walls, concrete boxes, poles."""
    return to_grey(140 + tileable_noise((128, 128), [(3, 6), (12, 8), (60, 12)], rng))


def car_side(rng: np.random.Generator, style: int) -> Grey:
    """The side of a car, 5.12 m long and 2.56 m up at 1 cm a texel, nose to the right, street at the bottom row."""
    w, h = 512, 256
    y = np.arange(h)[:, None]
    up = (h - 1 - y) * CAR_TEXEL_M
    body = 118 + 42 * np.exp(-(((up - 0.78) / 0.10) ** 2)) - 30 * np.exp(-(((up - 0.62) / 0.08) ** 2))
    image = np.broadcast_to(body - 42 * np.clip((0.5 - up) / 0.3, 0, 1), (h, w)).astype(np.float64).copy()
    image[(up < 0.22)[:, 0]] = 14
    image[((up > 0.22) & (up < 0.30))[:, 0]] *= 0.5

    def row(metres: float) -> int:
        return int(h - 1 - metres / CAR_TEXEL_M)

    tail, nose = (40, 300) if style == 0 else (22, 322)
    glass = np.array(
        [[tail + 18, row(0.92)], [tail + 52, row(1.36)], [nose - 60, row(1.36)], [nose, row(0.92)]]
    )
    cv2.fillPoly(image, [glass.astype(np.int32)], 30.0)
    shine = np.array(
        [[tail + 30, row(1.10)], [tail + 46, row(1.34)], [nose - 66, row(1.34)], [nose - 44, row(1.16)]]
    )
    cv2.fillPoly(image, [shine.astype(np.int32)], 58.0)
    for x in (tail + 95, tail + 190):
        cv2.line(image, (x, row(0.92)), (x + 4, row(1.36)), 70.0, 6)
        cv2.line(image, (x, row(0.92)), (x - 2, row(0.34)), 55.0, 2)
        cv2.rectangle(image, (x - 26, row(0.82)), (x - 10, row(0.79)), 60.0, -1)
    cv2.line(image, (10, row(0.92)), (420, row(0.90)), 165.0, 2)
    for x in (88, 346):
        cv2.circle(image, (x, row(0.33)), 39, 16.0, -1)
        cv2.circle(image, (x, row(0.32)), 31, 26.0, -1)
        cv2.circle(image, (x, row(0.32)), 21, 128.0, -1)
        for spoke in range(5):
            a = spoke * 2 * np.pi / 5 + 0.3
            tip = (int(x + 19 * np.cos(a)), int(row(0.32) + 19 * np.sin(a)))
            cv2.line(image, (x, row(0.32)), tip, 40.0, 4)
    cv2.rectangle(image, (412, row(0.74)), (440, row(0.60)), 190.0, -1)
    cv2.rectangle(image, (0, row(0.86)), (12, row(0.64)), 70.0, -1)
    return to_grey(image + rng.normal(0, 1.5, (h, w)))


def car_top(rng: np.random.Generator, style: int) -> Grey:
    """A car from above: bonnet, windscreen, roof; along x as `car_side`, 2.56 m wide."""
    w, h = 512, 256
    image = np.full((h, w), 150.0)
    image += 18 * np.cos(np.linspace(-2.4, 2.4, h))[:, None]
    tail, nose = (40, 300) if style == 0 else (22, 322)
    image[:, nose - 62 : nose + 6] = 34 + np.linspace(46, 0, 68)[None, :]
    image[:, tail : tail + 46] = 30.0
    cv2.line(image, (nose + 8, 0), (nose + 8, h), 60.0, 2)
    return to_grey(image + rng.normal(0, 1.5, (h, w)))


def car_end(rng: np.random.Generator, rear: bool) -> Grey:
    """Front or rear of a car, 2.56 m wide and 2.56 m up, middle at half width."""
    w = h = 256
    up = (h - 1 - np.arange(h)[:, None]) * CAR_TEXEL_M
    body = 112 + 34 * np.exp(-(((up - 0.82) / 0.09) ** 2)) - 26 * np.exp(-(((up - 0.6) / 0.05) ** 2))
    image = np.broadcast_to(body, (h, w)).astype(np.float64).copy()
    image[(up < 0.24)[:, 0]] = 14

    def box(x: float, low: float, wide: float, tall: float, tone: float) -> None:
        for side in (-1, 1):
            left = int(w / 2 + side * x / CAR_TEXEL_M - wide / 2 / CAR_TEXEL_M)
            top = int(h - 1 - (low + tall) / CAR_TEXEL_M)
            right, bottom = left + int(wide / CAR_TEXEL_M), int(h - 1 - low / CAR_TEXEL_M)
            cv2.rectangle(image, (left, top), (right, bottom), tone, -1)

    box(
        0.62,
        0.62 if not rear else 0.70,
        0.36 if not rear else 0.26,
        0.16 if not rear else 0.20,
        215.0 if not rear else 62.0,
    )
    box(0.55, 0.66, 0.10, 0.08, 245.0 if not rear else 110.0)
    box(0.0, 0.42 if not rear else 0.68, 0.52, 0.11, 205.0)
    if rear:
        box(0.0, 0.98, 1.20, 0.36, 32.0)
        box(0.0, 0.30, 1.40, 0.12, 44.0)
    else:
        box(0.0, 0.62, 0.70, 0.12, 34.0)
        box(0.0, 0.27, 1.0, 0.12, 30.0)
        box(0.0, 0.96, 1.2, 0.4, 30.0)
    box(0.62, 0.0, 0.22, 0.30, 18.0)
    return to_grey(image + rng.normal(0, 1.5, (h, w)))
