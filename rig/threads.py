"""One BLAS thread inside fits: small systems run up to tens of times slower, and erratically, on several."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _controller() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  (SciPy brings a BLAS of its own, which must be loaded to be found)

    # Finding the libraries takes milliseconds: once a process.
    return ThreadpoolController().select(user_api="blas")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit every BLAS of this process to one thread inside the block."""
    controller = _controller()
    if all(library.num_threads == 1 for library in controller.lib_controllers):
        yield  # setting and restoring what is so already would take as long as a small fit's algebra
        return
    with controller.limit(limits=1):
        yield
