"""How a plan is carried out on a station."""
