"""FlexMaps: flat panels of elastic spirals that spring into the surface you drew.

The same folder is Blender's extension and a plain Python package: Blender is only imported inside ``register``.
"""


def register() -> None:
    """Called by Blender when the extension is enabled; imports no numerics, so that enabling is quick."""
    import atexit

    import bpy

    from . import operators, panels
    from .bridge.store import settings
    from .command import main as command

    settings.register()
    operators.register()
    panels.register()
    command.register()
    # a Python that imported Blender crashes or hangs at its exit where classes are still registered
    if not bpy.app.binary_path:
        atexit.register(unregister)


def unregister() -> None:
    """Called by Blender when the extension is disabled; a running job is stopped first."""
    import atexit

    from . import operators, panels
    from .bridge.store import settings
    from .command import main as command

    atexit.unregister(unregister)
    command.unregister()
    panels.unregister()
    operators.unregister()
    settings.unregister()
