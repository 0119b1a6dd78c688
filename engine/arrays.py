"""Array types with shapes, such as ``Float[np.ndarray, "quads 4 3"]``, from jaxtyping, for type checkers and tests.

The program never evaluates annotations and doesn't need jaxtyping: at run time the names are ``Any``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxtyping import Bool, Complex, Float, Int, Num, Shaped
else:
    Bool = Complex = Float = Int = Num = Shaped = Any

__all__ = ["Bool", "Complex", "Float", "Int", "Num", "Shaped"]
