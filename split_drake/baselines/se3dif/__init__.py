"""SE(3)-DiffusionFields (Urain et al. 2023, arXiv 2209.03855)."""
