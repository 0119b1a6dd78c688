"""What a piece that another version of the program made is said to have, and what changed since."""

from __future__ import annotations

from . import VERSION

# Versions from which on a stage makes something else of the same input, and what, as a sentence for whoever opens an older piece.
# A line stands here for every change of that kind; what changed otherwise stands in the changelog.
CHANGED: tuple[tuple[str, str], ...] = (
    ("0.1.0", "Sheets have a grain now: wood and prints bend otherwise along it than across it"),
)
UNSTAMPED = "0.1"  # files from before the version was noted in them


class OtherVersion(UserWarning):
    """Given by ``api.load`` of a piece that another version made, where that makes a difference."""


def order(version: str) -> tuple[int, ...]:
    """What versions are compared by; of something that is no version, that of one which is older than all."""
    parts = version.split(".")
    return tuple(int(part) for part in parts) if all(part.isascii() and part.isdigit() for part in parts) else ()


def since(version: str, now: str = VERSION) -> tuple[str, ...]:
    """What changed from one version to another, the earliest first; nothing where that is as old or older."""
    return tuple(text for first, text in CHANGED if order(version) < order(first) <= order(now))


def said(version: str, now: str = VERSION) -> str:
    """A line for somebody who opens a piece of that version in this one; "" where nothing of it was changed."""
    if order(version) > order(now):
        return f"It was made with FlexMaps {version}, which is newer than this {now}: what is new there is not read"
    changed = since(version, now)
    return f"It was made with FlexMaps {version}, this is {now}; since then: {'; '.join(changed)}" if changed else ""
