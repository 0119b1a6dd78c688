"""FlexMaps on Blender's command line: commands and arguments, the api call behind each, and the printed summary."""
