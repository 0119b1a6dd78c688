"""Array types with shapes from jaxtyping, such as ``Float[np.ndarray, "quads 4 3"]``, and a base class of array tables.

Type checkers and tests use the shapes. The program never evaluates annotations and doesn't need jaxtyping: at run time
the names are ``Any``.
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
    """Base class of dataclasses whose fields are arrays, or other ``Columns``, with one row for each item."""

    def subset(self, rows: np.ndarray | slice) -> Self:
        """Select rows of all arrays; rows : row numbers, a mask or a slice. Fields that are not arrays are kept."""

        def select(value: Any) -> Any:
            if isinstance(value, Columns):
                return value.subset(rows)
            return value[rows] if hasattr(value, "dtype") else value

        return type(self)(*(select(getattr(self, column.name)) for column in fields(self)))  # type: ignore[arg-type]
