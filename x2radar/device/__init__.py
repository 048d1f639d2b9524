"""A module at a port: transport, link, bring-up, frames, and what happens when it is lost."""
