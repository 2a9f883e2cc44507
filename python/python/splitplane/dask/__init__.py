"""Batches of rays and points, and frames of animations, over the workers of a Dask cluster.

>>> from dask.distributed import Client                        # doctest: +SKIP
>>> import splitplane.dask                                     # doctest: +SKIP
>>> with splitplane.dask.share(tree, Client()) as shared:      # doctest: +SKIP
...     hits = shared.closest_hits(rays)

A tree goes once to each worker, which keeps its file, loads it once, and compares its digest. Batches go in chunks, of which only so many
are under way at a time. Answers are those of one machine, byte for byte, whatever the chunks and the workers.
"""

from __future__ import annotations

try:
    import distributed as _distributed  # noqa: F401
except ImportError as error:
    raise ImportError(
        f"splitplane.dask needs dask.distributed, which cannot be imported ({error}); install it by: pip install 'splitplane[dask]'"
    ) from error

from ..errors import ClusterError, DigestError
from ._frames import frames
from ._shared import CHUNK, SharedPointTree, SharedScene, SharedTree, share

__all__ = ["CHUNK", "ClusterError", "DigestError", "SharedPointTree", "SharedScene", "SharedTree", "frames", "share"]
