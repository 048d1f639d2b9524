"""The dashboard and HTTP interface: one isolated output, `-o http://HOST:PORT`.

A record's way to a page::

    radard.web.sink      takes records from the worker, starts the thread   [worker's thread]
    radard.web.history   the last of them                                    [any thread]
    radard.web.hub       hands them to every page, drops what one cannot take  [asyncio]
    radard.web.socket    one page
    radard.web.spectrograms      frames of the ring to columns of the pictures       [own thread]
    radard.web.picture_thread  runs the spectrograms while somebody watches
    radard.web.wire      columns to bytes
    radard.web.why       a decision in words
    radard.web.auth     who may look, who may arm
    radard.web.server    limits on connections; the thread itself

Nothing in here can hold up a decision: `write` appends to a list and returns, and the
pictures are made of what the ring still has, without its lock.
"""
