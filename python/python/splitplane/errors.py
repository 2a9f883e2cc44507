"""Exceptions. All are kinds of :class:`SplitplaneError`, and where Python has a kind of its own, of that too.

Texts are the library's: they say what is wrong and where.
"""

from __future__ import annotations


class SplitplaneError(Exception):
    """Anything that splitplane refuses."""

    def __new__(cls, *args: object) -> SplitplaneError:
        # Of two kinds of exceptions Python finds the second's, which refuses the class: whoever calls it, as tblib does when it brings
        # an exception from another process, would get a TypeError instead.
        return Exception.__new__(cls, *args)


class ShapeError(SplitplaneError, ValueError):
    """An array has the wrong shape."""


class DtypeError(SplitplaneError, TypeError):
    """An argument has a type, or an array a dtype, that is not taken."""


class RangeError(SplitplaneError, ValueError):
    """A number is beyond what can be held: float32 for coordinates, 32 bits for indices."""


class ConfigError(SplitplaneError, ValueError):
    """A setting is out of range, or has a name that nothing has."""


class MeshError(SplitplaneError, ValueError):
    """Arrays are not a mesh: a face names a vertex that does not exist, or there are too many."""


class SceneError(SplitplaneError, ValueError):
    """An edit of a scene was refused; the scene is what it was."""


class UnknownNameError(SceneError, LookupError):
    """There is no geometry or instance of this name."""


class StaleError(SplitplaneError, RuntimeError):
    """A scene was edited, and ``update()`` was not called since."""


class BuildError(SplitplaneError, RuntimeError):
    """A build gave no tree."""


class QueryError(SplitplaneError, RuntimeError):
    """A query gave no answer."""


class UnsupportedError(QueryError, NotImplementedError):
    """The backend does not answer this query."""


class OutOfMemoryError(SplitplaneError, MemoryError):
    """More memory is needed than allowed, or than there is."""


class CancelledError(SplitplaneError, RuntimeError):
    """The work was cancelled. Ctrl-C raises KeyboardInterrupt instead, and a callback's own exception is passed on."""


class DeviceError(SplitplaneError, RuntimeError):
    """A GPU failed."""


class OpenError(SplitplaneError, RuntimeError):
    """A backend could not be opened."""


class FileError(SplitplaneError, ValueError):
    """Bytes are not a file of this kind, or were damaged."""


class WrongMeshError(SplitplaneError, ValueError):
    """A tree was built over another mesh."""


class DigestError(SplitplaneError, ValueError):
    """A tree of another process has another digest than that which was shared with it."""


class ClusterError(SplitplaneError, RuntimeError):
    """A cluster gave no answer: there is none, or its workers died."""


class BusyError(SplitplaneError, RuntimeError):
    """Another thread is changing this object, or asking while this call would change it."""


class DeadHandleError(SplitplaneError, RuntimeError):
    """The object was closed, or was never built."""
