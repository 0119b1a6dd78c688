"""Long work tells how far it is, and stops when you want it to: here after two seconds.

Run it: blender -b --python examples/12_progress_and_stop.py
"""

import time

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

end = time.monotonic() + 2.0


def tell(fraction: float, text: str) -> None:
    """Called many times a second."""
    print(f"{fraction:4.0%} {text}")
    if time.monotonic() > end:
        raise api.Cancelled


piece = api.load("shape:three_holes", edge=20)
try:
    piece = api.optimise(piece, progress=tell)
except api.Cancelled:
    print("stopped; the piece is as it was before")
