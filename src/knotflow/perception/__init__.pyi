from .appearance import Appearance
from .camera import Camera, CameraError
from .image import ImageError, Label, RgbdImage
from .noise import NoiseConfig, add_noise
from .simulated import SimulatedCamera, View

__all__ = [
    "Appearance",
    "Camera",
    "CameraError",
    "ImageError",
    "Label",
    "NoiseConfig",
    "RgbdImage",
    "SimulatedCamera",
    "View",
    "add_noise",
]
