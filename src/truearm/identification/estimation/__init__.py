"""What an arm really is, identified from readings."""
