"""The shapes of arrays are checked at every call."""

from __future__ import annotations

import sys

sys.modules["flexmaps_shapes"].watch("engine", "database")
