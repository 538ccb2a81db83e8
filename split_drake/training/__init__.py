"""How SPLIT is trained."""
