"""``python3 tools/dev.py database``: hands the command to the database's own command line."""

from __future__ import annotations


def main(arguments: list[str]) -> int:
    from flexmaps.database import cli

    return cli.main(arguments)
