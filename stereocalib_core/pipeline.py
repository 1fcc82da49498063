"""The recipe: one stereo pair in, one small immutable result out."""

from __future__ import annotations

from stereocalib_core.config import PipelineConfig
from stereocalib_core.frames import StereoFrame
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.results import FrameResult
from stereocalib_core.road.stages import RoadStages


class FrontEnd:
    """Looks at the pixels of each frame once, in order. Keeps the previous pair for the tracks."""

    def __init__(self, camera: StereoCamera, config: PipelineConfig) -> None:
        self.camera = camera
        self.config = config

    def step(self, frame: StereoFrame) -> FrameResult:
        """One pair to its result; never raises for a bad frame."""
        raise ValueError(frame.index)

    def stages(self, frame: StereoFrame) -> RoadStages | None:
        """Every intermediate picture of one pair, for display; None where there are no images."""
        raise ValueError(frame.index)
