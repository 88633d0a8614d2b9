"""Links to real drivers: USB bulk, HID reports, an audio interface, an analog output, and TCP."""
