"""The tab, drawn into a list of lines: stands for Blender's layouts, which headless Blender cannot draw."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import bpy
from flexmaps import panels
from flexmaps.bridge.store.i18n import interface
from flexmaps.bridge.view.tab import CHECK_ITEMS, SECTIONS, WORKSHOP_ITEMS
from flexmaps.panels.sidebar import MainPanel


class Drawn:
    """Notes what is drawn; every property, operator, menu and popover must be there.

    lines : words in their order, with "! " before red ones; props, operators : what was drawn of them, by their names
    tight : words with the share of the tab's width that they have, where that is known
    """

    share = 1.0

    def __init__(self, above: Drawn | None = None):
        self.lines: list[str] = [] if above is None else above.lines
        self.props: list[tuple[str, str]] = [] if above is None else above.props
        self.operators: list[str] = [] if above is None else above.operators
        self.tight: list[tuple[str, float]] = [] if above is None else above.tight
        self.alert = above is not None and above.alert

    def _say(self, text: str) -> None:
        self.lines.append(("! " if self.alert else "") + text)

    def prop(self, owner: Any, name: str, text: str = "", expand: bool = False, **_: Any) -> None:
        assert name in owner.bl_rna.properties, name
        if expand:
            items = owner.bl_rna.properties[name].enum_items
            self.tight += [(interface(item.name), self.share / len(items)) for item in items]
        self.props.append((type(owner).__name__, name))
        if text:
            self._say(text)

    def prop_enum(self, owner: Any, name: str, value: str, **_: Any) -> None:
        assert value in {item.identifier for item in owner.bl_rna.properties[name].enum_items}
        self.prop(owner, name)

    def prop_search(self, owner: Any, name: str, where: Any, collection: str, **_: Any) -> None:
        assert collection in where.bl_rna.properties, name
        self.prop(owner, name)

    def operator(self, idname: str, text: str = "", **_: Any) -> Any:
        group, name = idname.split(".")
        kind = getattr(getattr(bpy.ops, group), name).get_rna_type()
        self.operators.append(idname)
        self._say(text or kind.name)
        return _Properties({prop.identifier for prop in kind.properties})

    def popover(self, panel: str, text: str = "", **_: Any) -> None:
        assert hasattr(bpy.types, panel), panel
        self._say(text)

    def menu(self, menu: str, text: str = "", **_: Any) -> None:
        assert hasattr(bpy.types, menu), menu
        self._say(text)

    def label(self, text: str = "", icon: str = "", **_: Any) -> None:
        self._say(text)
        if self.share < 1.0:
            self.tight.append((text, self.share))
        if icon in {"CANCEL", "CHECKMARK", "FILE_REFRESH"}:
            self._say(f"<{icon}>")

    def progress(self, text: str = "", **_: Any) -> None:
        self._say(text)

    def template_icon(self, icon_value: int, **_: Any) -> None:
        assert icon_value >= 0

    def separator(self, **_: Any) -> None:
        pass

    def panel_prop(self, owner: Any, name: str) -> Any:
        assert name in owner.bl_rna.properties, name
        return self._inner(), self._inner() if getattr(owner, name) else None

    def _inner(self, **_: Any) -> Drawn:
        inner = type(self)(self)
        inner.share = self.share
        return inner

    def split(self, factor: float = 0.0, **_: Any) -> Drawn:
        inner = self._inner()
        inner.parts = [factor, 1.0 - factor] if factor else []  # type: ignore[attr-defined]
        return inner

    def row(self, **_: Any) -> Drawn:
        inner, parts = self._inner(), getattr(self, "parts", [])
        inner.share = self.share * (parts.pop(0) if parts else 1.0)
        return inner

    column = box = _inner


class _Properties:
    """Of an operator's button: no others may be set than it has."""

    def __init__(self, names: set[str]):
        object.__setattr__(self, "_names", names)

    def __setattr__(self, name: str, value: Any) -> None:
        assert name in self._names, name


@contextmanager
def opened(section: str) -> Iterator[None]:
    """One section is open meanwhile; "" folds all."""
    tab = bpy.context.window_manager.flexmaps_tab
    for key in SECTIONS:
        setattr(tab, f"open_{key}", False)
    if section:
        setattr(tab, f"open_{section}", True)
    yield


def draw(section: str = "", layout: Drawn | None = None) -> list[str]:
    """The lines of the tab with a section open; or of a layout that notes more."""
    layout = Drawn() if layout is None else layout
    with opened(section):
        for method in (MainPanel.draw_header_preset, MainPanel.draw):
            method(SimpleNamespace(layout=layout), bpy.context)
    return layout.lines


def everything() -> Drawn:
    """All sections with all of their tabs, all popovers and menus."""
    layout, tab = Drawn(), bpy.context.window_manager.flexmaps_tab
    for section in SECTIONS:
        names = {"check": CHECK_ITEMS, "workshop": WORKSHOP_ITEMS}.get(section, (("",),))
        for kind, *_ in names:
            if kind:
                setattr(tab, {"check": "check", "workshop": "habits"}[section], kind)
            draw(section, layout)
    for cls in panels.CLASSES:
        if cls is not MainPanel and "draw" in vars(cls) and not issubclass(cls, bpy.types.AddonPreferences):
            cls.draw(SimpleNamespace(layout=layout, bl_ui_units_x=20), bpy.context)
    return layout
