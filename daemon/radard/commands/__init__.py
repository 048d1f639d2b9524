"""The subcommands of `radard`: one file each, with `run(argv) -> exit code`."""
