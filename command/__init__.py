"""FlexMaps on Blender's command line: its words, what each does with the api, and what is printed."""
