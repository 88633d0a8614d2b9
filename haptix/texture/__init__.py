"""Textures: the friction that a place on the screen should have."""

from haptix.texture.texture import Texture

__all__ = ["Texture"]
