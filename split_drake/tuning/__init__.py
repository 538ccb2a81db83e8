"""How the evaluator is tuned by physics."""
