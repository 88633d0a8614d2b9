"""Tasks: what haptix does with surfaces, materials and devices."""
