"""A client of `haptix serve`: another program's way to friction under a finger.

::

    with haptix.client.connect("demo") as h:
        h.layout_set({"regions": [...]})
        h.acquire()
        h.arm()
        for t_s, x_mm, y_mm in path:
            h.touch(x_mm, y_mm, t_s=t_s)

Needs the extra ``serve``. `connect_async` gives the same with ``await``.
"""

from haptix.client.asynchronous import AsyncClient as AsyncClient
from haptix.client.asynchronous import LostConnection as LostConnection
from haptix.client.asynchronous import Refused as Refused
from haptix.client.asynchronous import connect_async as connect_async
from haptix.client.plain import Client as Client
from haptix.client.plain import connect as connect
