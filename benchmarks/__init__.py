"""Every figure that the documentation states, measured again: ``python -m benchmarks`` lists them."""
