from .client.connection import AsyncClient as AsyncClient
from .client.connection import Client as Client
from .client.connection import Lost as Lost
from .client.connection import Refused as Refused
from .client.connection import connect as connect
from .client.connection import connect_async as connect_async
from .client.connection import feel as feel
