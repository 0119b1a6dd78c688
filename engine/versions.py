"""Compatibility with pieces made by other versions of the program: list the changes that affect their results."""

from __future__ import annotations

from . import VERSION

# Changes that alter the result of a stage for the same input: first version with the change, and a sentence for users
# who open an older piece. All such changes belong here; other changes are only in the changelog.
RESULT_CHANGES: tuple[tuple[str, str], ...] = (
    ("0.1.0", "Sheets have a grain now: wood and prints bend otherwise along it than across it"),
)
FIRST_VERSION = "0.1"  # version assumed for files that don't state theirs


class OtherVersion(UserWarning):
    """Warning of ``api.load``: another version made the piece, and results have changed since."""


def version_key(version: str) -> tuple[int, ...]:
    """Return the sort key of a version; texts that are not versions sort before all versions."""
    parts = version.split(".")
    return tuple(int(part) for part in parts) if all(part.isascii() and part.isdigit() for part in parts) else ()


def changes_between(version: str, now: str = VERSION) -> tuple[str, ...]:
    """Return the changes of results between two versions, earliest first; empty if ``now`` is not newer.

    Parameters
    ----------
    version, now : older and newer version, as "1.2.3"
    """
    return tuple(
        text for first, text in RESULT_CHANGES if version_key(version) < version_key(first) <= version_key(now)
    )


def version_warning(version: str, now: str = VERSION) -> str:
    """Return a warning for users who open a piece made with another version; "" if results have not changed since.

    Parameters
    ----------
    version : version that made the piece
    now : version of this program
    """
    if version_key(version) > version_key(now):
        return f"It was made with FlexMaps {version}, which is newer than this {now}: what is new there is not read"
    changed = changes_between(version, now)
    return f"It was made with FlexMaps {version}, this is {now}; since then: {'; '.join(changed)}" if changed else ""
