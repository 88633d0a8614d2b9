from . import contact as contact
from . import electro as electro
from . import fidelity as fidelity
from . import friction as friction
from . import perception as perception
from . import surface as surface
