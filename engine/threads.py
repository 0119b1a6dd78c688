"""One thread for small dense linear algebra: more of them only wait for each other."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])


@lru_cache(maxsize=1)
def _controller() -> Any:
    import scipy.linalg.lapack  # noqa: F401  its library must be loaded before the controller looks for it
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def one_thread(function: Function) -> Function:
    """A function that runs with one BLAS thread, on whatever machine; nothing changes for its caller."""

    @wraps(function)
    def limited(*args: Any, **kwargs: Any) -> Any:
        with _controller().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited  # type: ignore[return-value]
