"""The verbs of truearm, one module each: a function, and the record it returns. Both doors call them."""
