"""How the other methods are trained, on the scenes and labels that SPLIT is trained on."""
