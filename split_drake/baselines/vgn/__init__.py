"""VGN, the volumetric grasping network (Breyer et al. 2020, arXiv 2101.01132)."""
