"""Rows of the benches' tables: required value, measured value, and values of other programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

Row = dict[str, Any]


def row(mesh: str, name: str, asked: str, measured: Any, ok: bool | None, peer: dict[str, Any] | None = None) -> Row:
    """Make one row; ``ok`` is None without a required value."""
    return {"mesh": mesh, "row": name, "asked": asked, "measured": measured, "peer": peer or {}, "ok": ok}


def note(mesh: str, name: str, measured: Any, peer: dict[str, Any] | None = None) -> Row:
    """A row without a required value."""
    return row(mesh, name, "", measured, None, peer)


def at_most(mesh: str, name: str, limit: float | None, measured: float, peer: dict[str, Any] | None = None) -> Row:
    """A row whose figure may not exceed ``limit``; NaN never passes."""
    measured = float(f"{measured:.4g}") if isinstance(measured, float) else int(measured)
    if limit is None:
        return note(mesh, name, measured, peer)
    return row(mesh, name, f"<= {limit:g}", measured, bool(measured <= limit * (1 + 1e-9)), peer)


def at_least(mesh: str, name: str, limit: float, measured: float, peer: dict[str, Any] | None = None) -> Row:
    """A row whose figure must reach ``limit``."""
    return row(mesh, name, f">= {limit:g}", float(f"{measured:.4g}"), bool(measured >= limit), peer)


class Table:
    """Collects rows and prints each as it comes; ``width`` is that of the rows' names."""

    def __init__(self, width: int = 24):
        self.rows: list[Row] = []
        self._width = width
        print(f"{'mesh':<18}{'row':<{width}}{'asked':>12}{'measured':>14}  ok   peers")

    def add(self, *rows: Row) -> None:
        for one in rows:
            self._print(one)
            self.rows.append(one)

    def _print(self, one: Row) -> None:
        mark = {True: "yes", False: "NO", None: ""}[one["ok"]]
        peer = "; ".join(
            f"{name} " + (" ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else str(value))
            for name, value in one["peer"].items()
        )
        measured = f"{one['measured']:.5g}" if isinstance(one["measured"], float) else str(one["measured"])
        line = f"{one['mesh'] + ' ':<18}{one['row']:<{self._width}}{one['asked']:>12}{measured:>14}  {mark:<4} {peer}"
        print(line.rstrip(), flush=True)

    def finish(self, path: Path | None, keep: bool = False) -> None:
        """Write the rows as JSON, if asked, and say what was missed; ``keep`` the rows of other meshes that are there."""
        if path is not None:
            fresh = {r["mesh"] for r in self.rows}
            earlier = json.loads(path.read_text()) if keep and path.is_file() else []
            path.write_text(json.dumps([r for r in earlier if r["mesh"] not in fresh] + self.rows, indent=1) + "\n")
        missed = [r for r in self.rows if r["ok"] is False]
        print(f"{len(self.rows)} rows, {len(missed)} missed" + "".join(f"\n  {r['mesh']}: {r['row']}" for r in missed))
