"""Rooms beside the road from the mesh to the files; each folder can be taken out alone."""
