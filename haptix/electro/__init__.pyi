from .attraction import AreaFraction as AreaFraction
from .attraction import Attraction as Attraction
from .attraction import AttractionTable as AttractionTable
from .dielectric import VACUUM_PERMITTIVITY as VACUUM_PERMITTIVITY
from .dielectric import SkinDielectric as SkinDielectric
from .pull import Pull as Pull
from .pull import drive_strength as drive_strength
from .pull import drive_voltage as drive_voltage
