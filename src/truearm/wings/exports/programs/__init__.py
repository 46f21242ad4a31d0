"""Robot programs in the language of their controller: corrected target by target, all other bytes as they were."""
