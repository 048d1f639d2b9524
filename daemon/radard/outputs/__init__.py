"""Outputs: `base` is the contract of a sink, `fanout` opens those of -o/--output and hands on."""
