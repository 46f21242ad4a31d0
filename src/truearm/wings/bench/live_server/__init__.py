"""A page that shows a connected arm while its readings are taken, and the small server behind it."""
