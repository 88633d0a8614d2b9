"""What people can feel: detection thresholds, JND and sensation levels."""
