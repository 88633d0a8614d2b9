"""Links to real drivers: USB bulk, HID reports, an audio interface, and TCP."""
