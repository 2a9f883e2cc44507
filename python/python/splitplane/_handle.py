"""What has a compiled part, which can be given up."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

from .errors import DeadHandleError

Native = TypeVar("Native")


class Handle(Generic[Native]):
    """Holds the compiled part."""

    _own: Native | None = None

    @property
    def _native(self) -> Native:
        if self._own is None:
            raise DeadHandleError(f"this {type(self).__name__} was closed, or was never built")
        return self._own

    def close(self) -> None:
        """Gives its memory back. It answers nothing afterwards."""
        self._own = None

    @property
    def closed(self) -> bool:
        """Whether it was closed."""
        return self._own is None

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
