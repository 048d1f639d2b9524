"""A module at a port: transport, link, bring-up, frames, and what happens when it is lost.

It may import `x2radar.modules` and `x2radar.wire`.
"""
