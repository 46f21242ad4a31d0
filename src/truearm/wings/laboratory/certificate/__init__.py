"""Files for other programs: the digital calibration certificate of a verification."""
