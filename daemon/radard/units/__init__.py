"""Files for the system: udev rules and the systemd unit; `radard setup` prints them."""
