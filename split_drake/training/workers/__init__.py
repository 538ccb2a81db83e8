"""Training by several processes at once, which average their gradients."""
