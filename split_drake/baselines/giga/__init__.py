"""GIGA, grasps via implicit geometry and affordance (Jiang et al. 2021, arXiv 2104.01542)."""
