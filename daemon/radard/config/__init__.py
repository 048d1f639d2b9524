"""The configuration: from files, environment and options to one validated, frozen object."""
