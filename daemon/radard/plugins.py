"""Plug-ins of the daemon: sources, sinks and features that other distributions bring.

Each is called by its entry point's name; the contracts are `radard.stream.source.SourceOpener`,
`radard.outputs.registry.Opener` and `radard.judge.features.FeatureMaker`.
"""

import re

from x2radar.plugins import Plugin, find_plugin, plugin_names

SOURCES = "radard.sources"
SINKS = "radard.sinks"
FEATURES = "radard.features"
# Not a Windows port, and not a URL of pyserial's.
_SCHEME = re.compile(r"([a-z][a-z0-9+._-]+):(?!//)")

__all__ = ["FEATURES", "SINKS", "SOURCES", "Plugin", "plugged", "plugin_names", "scheme_of"]


def scheme_of(text: str) -> str:
    """Return the word before the colon; empty where there is none, or a URL follows."""
    match = _SCHEME.match(text)
    return match[1] if match else ""


def plugged(group: str, name: str) -> Plugin | None:
    """Return a plug-in; None if no distribution offers it, PluginError if it is broken."""
    return find_plugin(group, name) if name else None
