"""Limit BLAS to one thread: on small dense matrices, several threads only wait for each other."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])


@lru_cache(maxsize=1)
def _controller() -> Any:
    import scipy.linalg.lapack  # noqa: F401  the controller finds only libraries that are loaded already
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def one_thread(function: Function) -> Function:
    """Decorate a function to run with one BLAS thread."""

    @wraps(function)
    def limited(*args: Any, **kwargs: Any) -> Any:
        with _controller().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited  # type: ignore[return-value]
