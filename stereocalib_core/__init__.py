"""Estimation of a stereo camera's pose over the road, and everything that follows from it.

The face for scripts and notebooks:

    import stereocalib_core as sc

    drive = sc.calibrate("sequences/06")
    drive.mount.pitch_rad, drive.frames.to_pandas(), drive.paths["autocalibrated"].poses
    sc.write_run(drive, "out")

Names are loaded when they are first used, so that `import stereocalib_core` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stereocalib_core.back.analyse import analyse as analyse
    from stereocalib_core.boards.run import calibrate_boards as calibrate_boards
    from stereocalib_core.config import PipelineConfig as PipelineConfig
    from stereocalib_core.errors import StereoCalibError as StereoCalibError
    from stereocalib_core.files.run_folder import load_run as load_run
    from stereocalib_core.files.run_folder import write_run as write_run
    from stereocalib_core.front.matching import MATCHERS as MATCHERS
    from stereocalib_core.front.matching import Matcher as Matcher
    from stereocalib_core.front.pipeline import FrontEnd as FrontEnd
    from stereocalib_core.geometry import StereoCamera as StereoCamera
    from stereocalib_core.results import DisparityMap as DisparityMap
    from stereocalib_core.results import Drive as Drive
    from stereocalib_core.results import FrameResult as FrameResult
    from stereocalib_core.results import FrameTable as FrameTable
    from stereocalib_core.run.calibrate import calibrate as calibrate
    from stereocalib_core.run.compare import compare as compare
    from stereocalib_core.sources import open_source as open_source

__version__ = "0.1.0"

_PUBLIC = {
    "analyse": "back.analyse",
    "calibrate": "run.calibrate",
    "calibrate_boards": "boards.run",
    "compare": "run.compare",
    "load_run": "files.run_folder",
    "open_source": "sources",
    "write_run": "files.run_folder",
    "DisparityMap": "results",
    "Drive": "results",
    "FrameResult": "results",
    "FrameTable": "results",
    "FrontEnd": "front.pipeline",
    "MATCHERS": "front.matching",
    "Matcher": "front.matching",
    "PipelineConfig": "config",
    "StereoCalibError": "errors",
    "StereoCamera": "geometry",
}
__all__ = ["__version__", *_PUBLIC]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PUBLIC[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
