"""Types of arrays that say their shape, as in ``Float[np.ndarray, "quads 4 3"]``: jaxtyping's, which type checkers and tests read.

The program itself never evaluates annotations and needs no jaxtyping: there the names stand for nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxtyping import Bool, Complex, Float, Int, Num, Shaped
else:
    Bool = Complex = Float = Int = Num = Shaped = Any

__all__ = ["Bool", "Complex", "Float", "Int", "Num", "Shaped"]
