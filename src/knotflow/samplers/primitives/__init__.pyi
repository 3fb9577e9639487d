from .canonical import PRIMITIVES, UNDO, canonicalise, kinds_of, primitive_of
from .config import SHIPPED_PRIMITIVES, CemConfig, NetworkConfig, PrimitiveConfig
from .encoding import encode
from .library import FILE, LibraryError, PrimitiveLibrary, UnlikeRopeWarning
from .primitive import Actor, Critic, Primitive, cross_entropy

__all__ = [
    "FILE", "PRIMITIVES", "SHIPPED_PRIMITIVES", "UNDO", "Actor", "CemConfig", "Critic",
    "LibraryError", "NetworkConfig", "Primitive", "PrimitiveConfig", "PrimitiveLibrary",
    "UnlikeRopeWarning", "canonicalise", "cross_entropy", "encode", "kinds_of", "primitive_of",
]  # fmt: skip
