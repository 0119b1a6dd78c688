"""Offline: the fine level. Volumetric finite elements of one spiral, sampling, fitting, and the table that ships.

    geometry -> solid -> elastic -> statics -> linear, sampling -> chunks, build -> fits, table -> report

Everything is dimensionless: lengths in arm widths, stresses in Young's moduli. Nothing here travels with the add-on.
"""
