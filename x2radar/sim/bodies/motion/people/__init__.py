"""People: gaits, walking, crawling, what they do in one place; drawn footfalls."""
