"""The dashboard and HTTP interface: one isolated output, `-o http://HOST:PORT`.

A record's way to a page::

    sink            takes records from the worker, starts the thread       [worker's thread]
    history         the last of them                                       [any thread]
    hub             hands them to every page, drops what one cannot take   [asyncio]
    socket          one page
    pictures        frames of the ring, or of a clip, to columns of bytes  [own thread]
    why             a decision in words
    auth            roles: who may see, who may arm
    server          limits on connections; the thread itself

Nothing in here can hold up a decision: `write` appends to a list and returns, and the
pictures are made of what the ring still has, without its lock.
"""
