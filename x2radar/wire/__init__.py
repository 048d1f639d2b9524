"""The module's protocol: bytes to packets to messages and back. No port, no clock, no thread.

In order: `framing` (bytes and packets), `codec` by the rows in `messages` (packets and messages).
It imports `x2radar.errors` alone.
"""
