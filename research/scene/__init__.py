"""A scene as the radar sees it, by eye."""
