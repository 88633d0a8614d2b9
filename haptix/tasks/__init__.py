"""Tasks of the desk: what haptix does with surfaces, materials and devices."""
