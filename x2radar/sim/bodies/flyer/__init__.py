"""Birds and moths: where they fly and what of them echoes. It may import `skin`."""
