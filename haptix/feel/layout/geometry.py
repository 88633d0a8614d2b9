"""From the pixels of an app to millimetres on the screen."""

from __future__ import annotations

from typing import Literal, Self

from haptix.base.checks import Number, Positive, checked, number, positive
from haptix.base.errors import InputError
from haptix.model.screen import Screen

INCH_MM = 25.4


@checked()
class ScreenGeometry:
    """Where an app's pixels are on the screen; millimetres count from the screen's corner.

    Parameters
    ----------
    pixels_x, pixels_y : float
        Resolution, as the app counts its pixels: logical ones, if it draws in these.
    width_mm, height_mm : float
        Size of the picture on the screen, as the screen is built.
    origin_x_mm, origin_y_mm : float
        Corner of the picture on the touch-sensitive area.
    rotation_deg : {0, 90, 180, 270}
        How far the app's picture is turned on the screen, clockwise.

    Examples
    --------
    >>> screen = ScreenGeometry(1920, 1080, width_mm=192.0, height_mm=108.0)
    >>> screen.mm(960, 540)
    (96.0, 54.0)
    >>> screen.pixels(96.0, 54.0)
    (960.0, 540.0)
    """

    pixels_x: Positive
    pixels_y: Positive
    width_mm: Positive
    height_mm: Positive
    origin_x_mm: Number = 0.0
    origin_y_mm: Number = 0.0
    rotation_deg: Literal[0, 90, 180, 270] = 0

    @classmethod
    def of_dpi(cls, pixels_x: float, pixels_y: float, dpi: float) -> Self:
        """Geometry of square pixels, so many to an inch.

        Parameters
        ----------
        pixels_x, pixels_y : float
            Size of the picture [pixels].
        dpi : float
            Pixels to an inch.

        Examples
        --------
        >>> ScreenGeometry.of_dpi(1920, 1080, dpi=96).width_mm  # 20 inches
        508.0
        """
        pixel_mm = INCH_MM / positive("dpi", dpi)
        return cls(pixels_x, pixels_y, pixels_x * pixel_mm, pixels_y * pixel_mm)

    @classmethod
    def on(
        cls,
        screen: Screen,
        pixels_x: float,
        pixels_y: float,
        origin_x_mm: float = 0.0,
        origin_y_mm: float = 0.0,
        rotation_deg: Literal[0, 90, 180, 270] = 0,
    ) -> Self:
        """Geometry of a screen whose profile has its size.

        Parameters
        ----------
        screen : Screen
        pixels_x, pixels_y : float
            Size of the app's picture [pixels].
        origin_x_mm, origin_y_mm : float
            Corner of the picture on the touch-sensitive area [mm].
        rotation_deg : int
            How far the picture is turned: 0, 90, 180 or 270 degrees.

        Examples
        --------
        >>> from haptix.model import Screen
        >>> screen = Screen(width_mm=300.0, height_mm=200.0)
        >>> ScreenGeometry.on(screen, 1920, 1280).mm(960, 640)
        (150.0, 100.0)
        """
        if screen.width_mm is None or screen.height_mm is None:
            raise InputError(
                f"screen: expected a profile with width_mm and height_mm, but {screen.name!r} has "
                "none; measure the picture, or use of_dpi"
            )
        size = (screen.width_mm, screen.height_mm)
        return cls(pixels_x, pixels_y, *size, origin_x_mm, origin_y_mm, rotation_deg)

    def mm(self, x_px: float, y_px: float) -> tuple[float, float]:
        """Place on the screen [mm] of a place in the app's picture [pixels].

        Parameters
        ----------
        x_px, y_px : float
            The place [pixels].

        Examples
        --------
        >>> ScreenGeometry(1920, 1080, width_mm=480.0, height_mm=270.0).mm(960, 540)
        (240.0, 135.0)
        """
        across = number("x_px", x_px) / self.pixels_x
        down = number("y_px", y_px) / self.pixels_y
        turned = {
            0: (across, down), 90: (1 - down, across),
            180: (1 - across, 1 - down), 270: (down, 1 - across),
        }  # fmt: skip
        x, y = turned[self.rotation_deg]
        return self.origin_x_mm + x * self.width_mm, self.origin_y_mm + y * self.height_mm

    def pixels(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Place in the app's picture [pixels] of a place on the screen [mm].

        Parameters
        ----------
        x_mm, y_mm : float

        Examples
        --------
        >>> ScreenGeometry(1920, 1080, width_mm=480.0, height_mm=270.0).pixels(240.0, 135.0)
        (960.0, 540.0)
        """
        x = (number("x_mm", x_mm) - self.origin_x_mm) / self.width_mm
        y = (number("y_mm", y_mm) - self.origin_y_mm) / self.height_mm
        turned = {0: (x, y), 90: (y, 1 - x), 180: (1 - x, 1 - y), 270: (1 - y, x)}
        across, down = turned[self.rotation_deg]
        return across * self.pixels_x, down * self.pixels_y
