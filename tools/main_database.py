"""``python3 tools/dev.py database``: passes its arguments to the command line of the database."""

from __future__ import annotations


def main(arguments: list[str]) -> int:
    from flexmaps.database import cli

    return cli.main(arguments)
