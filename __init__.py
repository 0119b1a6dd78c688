"""FlexMaps: flat panels of elastic spirals that spring into the surface you drew.

The same folder is Blender's extension and a plain Python package: Blender is only imported inside ``register``.
"""


def register() -> None:
    """Register all classes; Blender calls it when the extension is enabled. It imports no numerics, for speed."""
    import atexit

    import bpy

    from . import operators, panels
    from .bridge.store import derived_properties, settings
    from .command import main as command

    settings.register()
    derived_properties.register()
    operators.register()
    panels.register()
    command.register()
    # with Blender as a Python module, Python crashes or hangs at exit if classes are still registered
    if not bpy.app.binary_path:
        atexit.register(unregister)


def console() -> None:
    """Run the shell command ``flexmaps`` of the pip package, with Blender as a Python module; end the process."""
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

    register()  # so that saved .blend files contain the settings
    status = command.main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # skip Blender's clean-up at exit, which prints pages of errors and may hang


def unregister() -> None:
    """Unregister all classes and stop a running job; Blender calls it when the extension is disabled."""
    import atexit

    from . import operators, panels
    from .bridge.store import derived_properties, settings
    from .command import main as command

    atexit.unregister(unregister)
    command.unregister()
    panels.unregister()
    operators.unregister()
    derived_properties.unregister()
    settings.unregister()
