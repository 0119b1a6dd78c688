"""FlexMaps: flat panels of elastic spirals that spring into the surface you drew.

The same folder is Blender's extension and a plain Python package: Blender is only imported inside ``register``.
"""


def register() -> None:
    """Called by Blender when the extension is enabled; imports no numerics, so that enabling is quick."""
    import atexit

    import bpy

    from . import operators, panels
    from .bridge.store import decided, settings
    from .command import main as command

    settings.register()
    decided.register()
    operators.register()
    panels.register()
    command.register()
    # a Python that imported Blender crashes or hangs at its exit where classes are still registered
    if not bpy.app.binary_path:
        atexit.register(unregister)


def console() -> None:
    """The command ``flexmaps`` where the package was installed by pip beside Blender as a Python module; ends the process."""
    import os
    import sys

    try:
        import bpy  # noqa: F401
    except ImportError:
        print(
            "flexmaps: Blender as a Python module is not here; pip install bpy, of the release for your Python",
            file=sys.stderr,
        )
        sys.exit(2)
    from .command import main as command

    register()  # so that a .blend carries the settings of the run
    status = command.main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # Blender as a module complains for pages at the end of a process, and may wait for ever


def unregister() -> None:
    """Called by Blender when the extension is disabled; a running job is stopped first."""
    import atexit

    from . import operators, panels
    from .bridge.store import decided, settings
    from .command import main as command

    atexit.unregister(unregister)
    command.unregister()
    panels.unregister()
    operators.unregister()
    decided.unregister()
    settings.unregister()
