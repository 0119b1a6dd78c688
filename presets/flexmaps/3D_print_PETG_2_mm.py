# PETG of 2 mm on a 3D printer; tougher than PLA
import bpy

settings = bpy.context.object.flexmaps

settings.remesh.edge = 25.0
settings.spiral.thickness = 2.0
settings.spiral.width_min = 1.2
settings.spiral.width_max = 2.4
settings.spiral.slot_min = 0.5
settings.spiral.slot_seam = 2.5
settings.spiral.fillet = 0.25
settings.material.material = "petg"
settings.connect.connector = "dovetail"
settings.connect.clearance = 0.1
settings.connect.thinnest = 1.2
settings.connect.rounding = 0.3
settings.cut.kerf_outline = 0.0
settings.cut.kerf_holes = 0.0
settings.cut.mill = 0.0
settings.cut.nozzle = 0.4
settings.cut.line_width = 0.1
settings.cut.svg_unit = "mm"
settings.cut.lead_in = 0.0
settings.cut.tabs = 0
settings.cut.tab_width = 1.0
settings.sheet.sheet_width = 220.0
settings.sheet.sheet_height = 220.0
settings.sheet.margin = 5.0
settings.sheet.spacing = 5.0
settings.sheet.rotation = "FREE"
settings.sheet.labels = True
settings.export.svg = False
settings.export.dxf = "NONE"
settings.export.pdf = False
settings.export.solids = "3MF"
