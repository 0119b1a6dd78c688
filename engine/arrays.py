"""Array types with shapes, such as ``Float[np.ndarray, "quads 4 3"]``, from jaxtyping, and a base of dataclasses of arrays.

Type checkers and tests use the shapes. The program never evaluates annotations and doesn't need jaxtyping: at run time the names are ``Any``.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing import Self

    import numpy as np
    from jaxtyping import Bool, Complex, Float, Int, Num, Shaped
else:
    Bool = Complex = Float = Int = Num = Shaped = Any

__all__ = ["Bool", "Columns", "Complex", "Float", "Int", "Num", "Shaped"]


class Columns:
    """Base of dataclasses whose fields are arrays with equally many rows, one for each item."""

    def subset(self, rows: np.ndarray) -> Self:
        """Return some rows of all fields; ``rows`` holds their numbers or a mask."""
        return type(self)(*(getattr(self, column.name)[rows] for column in fields(self)))  # type: ignore[arg-type]
