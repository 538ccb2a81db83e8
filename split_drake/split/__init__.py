"""SPLIT: an SE(3)-diffusion model that finds poses by the geometry around them (paper IV)."""
