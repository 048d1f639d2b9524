"""Pet-immune radar alarm: the driver. See README.md."""
