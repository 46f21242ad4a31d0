"""What readings and results are worth: gross errors, cross-validation, other days, a wrong description."""
