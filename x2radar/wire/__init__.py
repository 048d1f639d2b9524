"""The module's protocol: bytes to packets to messages and back. No port, no clock, no thread.

In order: `framing` (bytes and packets), `codec` by the tables in `layouts` (packets and messages),
`protocol` (which reply belongs to which command). It imports `x2radar.errors` alone.
"""
