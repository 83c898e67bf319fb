"""One BLAS thread inside fits: small systems run up to tens of times slower, and erratically, on several."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


@cache
def _controller() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  (SciPy brings a BLAS of its own, which must be loaded to be found)

    # Finding the libraries takes milliseconds: once a process.
    return ThreadpoolController().select(user_api="blas")


@cache
def _threads() -> tuple[Callable[[], Any], ...]:
    """What tells how many threads each library uses, without looking the function up each time."""
    names = [f"{prefix}openblas_get_num_threads{suffix}" for prefix in ("scipy_", "") for suffix in ("64_", "")]

    def of(library: Any) -> Callable[[], Any]:
        loaded = ctypes.CDLL(library.filepath)
        found: Callable[[], Any] = library.get_num_threads
        return next((getattr(loaded, name) for name in names if hasattr(loaded, name)), found)

    return tuple(of(library) for library in _controller().lib_controllers)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit every BLAS of this process to one thread inside the block."""
    if all(threads() == 1 for threads in _threads()):
        yield  # setting and restoring what is so already would take as long as a small fit's algebra
        return
    with _controller().limit(limits=1):
        yield
