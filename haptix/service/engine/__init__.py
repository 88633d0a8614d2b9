"""The process that owns the surface, the renderer and the device."""
