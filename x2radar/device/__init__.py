"""A module at a port: transport, link, bring-up, frames, and what happens when it is lost.

It may import `x2radar.settings` and `x2radar.wire`.
"""
