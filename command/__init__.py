"""FlexMaps on Blender's command line: the commands, their arguments, and the printed summary."""
