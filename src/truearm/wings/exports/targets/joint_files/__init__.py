"""Joint targets in the files of other programs, in which corrected joints replace the numbers and nothing else."""
