from .appearance import Appearance
from .camera import Camera, CameraError
from .certainty import CrossingEvidence, weigh_crossings
from .estimation import EstimateConfig, RopeEstimate, estimate
from .fitting import FitConfig, fit, image_loss, project_lengths, shape_loss
from .image import ImageError, Label, RgbdImage
from .lifting import lift
from .losses import Target
from .noise import NoiseConfig, add_noise
from .rendering import render
from .sample import SAMPLE
from .segmentation import Segmentation, segment
from .simulated import SimulatedCamera, View
from .tracing import Trace, TraceError, trace
from .uncertainty import spread
from .unmixing import coverage

__all__ = [
    "SAMPLE",
    "Appearance",
    "Camera",
    "CameraError",
    "CrossingEvidence",
    "EstimateConfig",
    "FitConfig",
    "ImageError",
    "Label",
    "NoiseConfig",
    "RgbdImage",
    "RopeEstimate",
    "Segmentation",
    "SimulatedCamera",
    "Target",
    "Trace",
    "TraceError",
    "View",
    "add_noise",
    "coverage",
    "estimate",
    "fit",
    "image_loss",
    "lift",
    "project_lengths",
    "render",
    "segment",
    "shape_loss",
    "spread",
    "trace",
    "weigh_crossings",
]
