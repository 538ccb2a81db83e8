"""The simulated table, with its robot and depth cameras."""
