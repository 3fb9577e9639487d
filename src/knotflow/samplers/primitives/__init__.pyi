from .canonical import (
    ARRANGE,
    PRIMITIVES,
    UNDO,
    Canonical,
    canonicalise,
    kinds_of,
    primitive_of,
)
from .config import SHIPPED_PRIMITIVES, VARIANTS, CemConfig, NetworkConfig, PrimitiveConfig
from .encoding import Encoded, Frames, encode
from .library import FILE, LibraryError, PrimitiveLibrary, UnlikeRopeWarning
from .networks import Actor, Critic
from .primitive import Primitive, cross_entropy

__all__ = [
    "ARRANGE",
    "FILE",
    "PRIMITIVES",
    "SHIPPED_PRIMITIVES",
    "UNDO",
    "VARIANTS",
    "Actor",
    "Canonical",
    "CemConfig",
    "Critic",
    "Encoded",
    "Frames",
    "LibraryError",
    "NetworkConfig",
    "Primitive",
    "PrimitiveConfig",
    "PrimitiveLibrary",
    "UnlikeRopeWarning",
    "canonicalise",
    "cross_entropy",
    "encode",
    "kinds_of",
    "primitive_of",
]
