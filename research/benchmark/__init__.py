"""A benchmark that others can enter: fixed tasks, peers' methods, one page of results."""
