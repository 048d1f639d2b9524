"""Foreign recording formats: one file each, with a reader and, where it can, a `write`.

`read_foreign` and `write_foreign` know them all; their modules are loaded when needed.
"""
