"""What is wrong with a polygon mesh, and the quad mesh once nothing is."""
