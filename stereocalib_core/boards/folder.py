"""A folder of pictures and clouds: `images/`, `clouds/`, `camera.yaml`, `board.yaml`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.cloud_files import SUFFIXES
from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.errors import ConfigError, SourceError
from stereocalib_core.system.yaml_file import read_mapping

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")


@dataclass(frozen=True)
class BoardFolder:
    """What there is to calibrate from.

    names: every NAME found, sorted. images, clouds: NAME to file; a name may be missing in one of them.
    camera: None when it is to be estimated. cropped: whether clouds hold the board only.
    notes: what was read otherwise than it was named.
    """

    path: Path
    names: tuple[str, ...]
    images: dict[str, Path]
    clouds: dict[str, Path]
    board: BoardSpec
    camera: BoardCamera | None
    cropped: bool
    notes: tuple[str, ...] = ()


def open_folder(
    path: Path, pairs: list[str] | None = None, exclude: list[str] | None = None, cropped: bool = False
) -> BoardFolder:
    """List and check a folder; `pairs` keeps only these names, `exclude` drops some.

    Raises SourceError or ConfigError for a folder, a setting or a name that cannot be used.
    """
    cloud_dir = path / ("clouds_cropped" if cropped else "clouds")
    for needed in (path, path / "images", cloud_dir):
        if not needed.is_dir():
            raise SourceError(
                "no folder of boards", needed, f"expected images/, {cloud_dir.name}/, camera.yaml, board.yaml"
            )
    images = _by_name(path / "images", PICTURE_SUFFIXES)
    clouds = _by_name(cloud_dir, SUFFIXES)
    clouds, notes = _paired_by_number(images, clouds)
    names = sorted(set(images) | set(clouds))
    if not names:
        raise SourceError(
            "no pictures and no clouds", path, "put NAME.png into images/ and NAME.pcd into clouds/"
        )
    for asked in (pairs or []) + (exclude or []):
        if asked not in names:
            raise SourceError(f"no pair named {asked!r}", path, f"there are {', '.join(names)[:200]}")
    kept = [n for n in names if (not pairs or n in pairs) and n not in (exclude or [])]
    if not kept:
        raise SourceError("no pair is left", path, "exclude fewer")
    return BoardFolder(
        path,
        tuple(kept),
        images,
        clouds,
        load_board(path / "board.yaml"),
        load_camera(path / "camera.yaml"),
        cropped,
        notes,
    )


def _paired_by_number(
    images: dict[str, Path], clouds: dict[str, Path]
) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Clouds under the names of the pictures that end in the same number, where no name is the same."""
    lone_images, lone_clouds = sorted(set(images) - set(clouds)), sorted(set(clouds) - set(images))
    by_number: dict[int, list[str]] = {}
    for name in lone_clouds:
        if (number := _last_number(name)) is not None:
            by_number.setdefault(number, []).append(name)
    numbers = [_last_number(name) for name in lone_images]
    renamed = {}
    for name, number in zip(lone_images, numbers, strict=True):
        if number is not None and numbers.count(number) == 1 and len(by_number.get(number, [])) == 1:
            renamed[by_number[number][0]] = name
    if not renamed:
        return clouds, ()
    first, own = next(iter(renamed.items()))
    paired = {renamed.get(name, name): path for name, path in clouds.items()}
    told = f"pictures and clouds pair up by the number at their end, {own} with {first} and so on"
    return paired, (f"{told} ({len(renamed)} pairs)",)


def _last_number(name: str) -> int | None:
    found = re.search(r"(\d{1,18})\D*$", name)
    return int(found.group(1)) if found else None


def _by_name(folder: Path, suffixes: tuple[str, ...]) -> dict[str, Path]:
    found: dict[str, Path] = {}
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() in suffixes and not file.name.startswith(".") and file.is_file():
            if file.stem in found:
                raise SourceError(
                    f"two files for {file.stem!r}",
                    folder,
                    f"keep one of {found[file.stem].name}, {file.name}",
                )
            found[file.stem] = file
    return found


def load_board(path: Path) -> BoardSpec:
    """`columns`, `rows`, `square_m`, optional `width_m`, `height_m`."""
    values = read_mapping(path, "settings")
    try:
        return BoardSpec(
            _whole(values["columns"]),
            _whole(values["rows"]),
            _number(values["square_m"]),
            _number(values.get("width_m") or 0.0),
            _number(values.get("height_m") or 0.0),
        )
    except KeyError as error:
        raise ConfigError(
            f"board has no {error.args[0]}", path, "give columns, rows (inner corners) and square_m"
        ) from error
    except (TypeError, ValueError, OverflowError) as error:
        raise ConfigError("board has a value that is no number", path, str(error)[:120]) from error


def _number(value: Any) -> float:
    """A number, also one written with a decimal comma."""
    return float(value.replace(",", ".") if isinstance(value, str) else value)


def _whole(value: Any) -> int:
    if isinstance(value, bool) or float(value) != int(value):
        raise ValueError(f"{value!r} is no whole number")
    return int(value)


def load_camera(path: Path) -> BoardCamera | None:
    """`model`, `width`, `height`, `K`, `D`; None for `model: estimate`."""
    values = read_mapping(path, "settings")
    model = values.get("model", "pinhole")
    if model == "estimate":
        return None
    try:
        K = np.array(values["K"], dtype=np.float64)
        D = np.array(values.get("D") or [], dtype=np.float64).reshape(-1)
        K = K.reshape(3, 3) if K.size == 9 else K
        return BoardCamera(model, _whole(values["width"]), _whole(values["height"]), K, D)
    except KeyError as error:
        raise ConfigError(
            f"camera has no {error.args[0]}", path, "give model, width, height, K, D"
        ) from error
    except (TypeError, ValueError, OverflowError) as error:
        raise ConfigError("camera has a value that is no number", path, str(error)[:120]) from error


def read_picture(path: Path, camera: BoardCamera | None) -> NDArray[np.uint8]:
    """(H, W) grey; refuses a picture that cannot be decoded or has another size than the camera."""
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if picture is None:
        raise SourceError("picture cannot be read", path, "write it again as PNG or JPEG")
    if camera is not None and picture.shape != (camera.height, camera.width):
        raise SourceError(
            f"picture is {picture.shape[1]}x{picture.shape[0]}",
            path,
            f"camera.yaml says {camera.width}x{camera.height}",
        )
    return np.asarray(picture, dtype=np.uint8)
