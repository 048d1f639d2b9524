"""The dashboard and HTTP interface: one isolated output, `-o http://HOST:PORT`.

A record's way to a page::

    sink            takes records from the worker; the server's thread     [worker's thread]
    view            what is held of a sensor: history, counters, pictures  [any thread]
    hub             hand them to every page, drop what one cannot take     [asyncio]
    pictures        frames of the ring, or of a clip, to columns of bytes  [own thread]

and a request's way::

    server          limits on connections
    auth, guard     hosts, origins, bodies; roles: who may see, who may arm
    api, events     the routes
"""
