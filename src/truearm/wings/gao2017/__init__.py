"""The founding paper (Gao et al., Complexity 2017, 5156264) reproduced: its experiment, tables, figures and claims."""
